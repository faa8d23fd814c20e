"""One whole evaluation: a data set, a planner, a method; needs no running site."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from muster_schemas.site import Site

from muster_planner.offline import open_offline
from muster_planner.surroundings import Surroundings

from .cases import read_cases
from .measures import Answer, Evaluation, summarise
from .running import Judge, chosen
from .smart_llm import SmartLlm

Progress = Callable[[int, int, int], None]
"""Called after each answer with (right answers, answers, answers in all)."""


@dataclass(frozen=True)
class Asked:
    """What is to be evaluated."""

    dataset: Path
    site: Site
    planner: str = "embedded"
    method: Literal["dart-llm", "smart-llm"] = "dart-llm"
    dependencies: bool = True
    repeat: int = 1
    limit: int | None = None


def evaluate(asked: Asked, progress: Progress) -> Evaluation | None:
    """Return the evaluation; after Ctrl-C that of the answers so far, None if there are none.

    Raises:
        DatasetError: the data set cannot be read.
        SetupError: the model cannot be had, or cannot do what the method asks for.

    """
    there = Surroundings.of_file(asked.site)
    cases = chosen(read_cases(asked.dataset, there), asked.limit)
    judge = Judge(there, dependencies=asked.dependencies)
    answers: list[Answer] = []
    complete = False
    with open_offline(asked.site, asked.planner, wrap=SmartLlm if asked.method == "smart-llm" else None) as planner:
        try:
            for answer in judge.answers(cases, planner, repeat=asked.repeat):
                answers.append(answer)
                progress(sum(a.right for a in answers), len(answers), len(cases) * asked.repeat)
            complete = True
        except KeyboardInterrupt:
            pass
    if not answers:
        return None
    return summarise(
        answers,
        dataset=asked.dataset.name,
        planner=asked.planner,
        method=asked.method,
        dependencies=asked.dependencies,
        repeat=asked.repeat,
        limit=asked.limit,
        complete=complete,
    )
