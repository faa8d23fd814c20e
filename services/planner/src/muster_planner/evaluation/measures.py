"""The numbers of an evaluation, as they stand in its result file, and how they come from single answers."""

import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pydantic import BaseModel

from .cases import Case
from .scoring import Score


class Answer(BaseModel):
    """What became of one case in one repeat."""

    id: str
    level: str
    voice: str = ""
    repeat: int
    text: str
    must_refuse: bool
    refused: bool
    """There is no plan, and the instruction (not the model's failure) is why."""
    right: bool
    ipa: float = 0.0
    dsr: float = 0.0
    sgsr: float = 0.0
    why: str = ""
    diff: tuple[str, ...] = ()
    error: str | None = None
    seconds: float
    queues: float = 0.0
    """1 if the plan without its dependencies is right, each robot doing its tasks in the order of the list."""
    listed: float = 0.0
    """The same, one task after another."""
    listed_in_order: float = 0.0
    """The same, if nothing need be done in parallel."""
    plan: dict[str, Any] | None = None
    """What was planned; kept of wrong answers only."""

    @classmethod
    def scored(cls, case: Case, score: Score, **fields: Any) -> "Answer":
        """Return the answer to a case that has a plan."""
        return cls(
            id=case.id,
            level=case.level,
            voice=case.voice,
            text=case.text,
            must_refuse=False,
            right=score.right,
            ipa=score.ipa,
            dsr=score.dsr,
            sgsr=score.sgsr,
            why=score.why,
            diff=score.diff,
            **fields,
        )


class Row(BaseModel):
    """One line of the table: a level, or all of them."""

    level: str
    cases: int
    sr: float
    sr_spread: float
    """Standard deviation of SR over the repeats; 0 with one."""
    ipa: float
    dsr: float
    sgsr: float
    rtr: float
    mean_s: float
    sd_s: float


class AblationRow(BaseModel):
    """SR of one level with and without dependencies."""

    level: str
    with_dependencies: float
    queues: float
    listed: float
    listed_in_order: float


class Refusals(BaseModel):
    """Instructions that cannot be done, and those that can."""

    to_refuse: int
    rightly_refused: int
    good: int
    wrongly_refused: int


class Evaluation(BaseModel):
    """The whole result; what `--out` writes as JSON."""

    dataset: str
    planner: str
    method: str
    dependencies: bool
    repeat: int
    limit: int | None = None
    """So many cases were drawn from the data set; None: all."""
    complete: bool
    rows: tuple[Row, ...]
    ablation: tuple[AblationRow, ...]
    refusals: Refusals
    p50_s: float
    p95_s: float
    answers: tuple[Answer, ...]
    labels: dict[str, str | float] = {}
    """What else the one who ran it wants to remember, such as the tokens that a model was trained on."""

    @property
    def failures(self) -> tuple[Answer, ...]:
        """Return the wrong answers, each case once."""
        return tuple({a.id: a for a in self.answers if not a.right}.values())


def summarise(answers: Sequence[Answer], **fields: Any) -> Evaluation:
    """Return the evaluation of some answers (at least one)."""
    good = [a for a in answers if not a.must_refuse]
    levels = sorted({a.level for a in good})
    seconds = [a.seconds for a in answers]
    return Evaluation(
        rows=tuple(_row(name, _of(good, name)) for name in (*levels, *(["all"] if good else []))),
        ablation=tuple(_ablation(name, _of(good, name)) for name in (*levels, *(["all"] if good else []))),
        refusals=Refusals(
            to_refuse=len(answers) - len(good),
            rightly_refused=sum(a.right for a in answers if a.must_refuse),
            good=len(good),
            wrongly_refused=sum(a.refused for a in good),
        ),
        p50_s=quantile(seconds, 0.5),
        p95_s=quantile(seconds, 0.95),
        answers=tuple(answers),
        **fields,
    )


def reliability(seconds: Iterable[float]) -> float:
    """Return RTR, mean / (mean + standard deviation): 1 if all take equally long, 1/2 if they scatter by their mean."""
    times = list(seconds)
    mean = statistics.fmean(times)
    return mean / (mean + statistics.pstdev(times)) if mean else 1.0


def quantile(values: Sequence[float], share: float) -> float:
    """Return the smallest value that at least this share of the values do not exceed."""
    return sorted(values)[max(0, math.ceil(share * len(values)) - 1)]


def _of(answers: Sequence[Answer], level: str) -> list[Answer]:
    return [a for a in answers if level in (a.level, "all")]


def _row(level: str, answers: Sequence[Answer]) -> Row:
    repeats = sorted({a.repeat for a in answers})
    by_repeat = [statistics.fmean(a.right for a in answers if a.repeat == n) for n in repeats]
    seconds = [a.seconds for a in answers]
    return Row(
        level=level,
        cases=len({a.id for a in answers}),
        sr=_mean(answers, lambda a: a.right),
        sr_spread=statistics.pstdev(by_repeat),
        ipa=_mean(answers, lambda a: a.ipa),
        dsr=_mean(answers, lambda a: a.dsr),
        sgsr=_mean(answers, lambda a: a.sgsr),
        rtr=reliability(seconds),
        mean_s=statistics.fmean(seconds),
        sd_s=statistics.pstdev(seconds),
    )


def _ablation(level: str, answers: Sequence[Answer]) -> AblationRow:
    return AblationRow(
        level=level,
        with_dependencies=_mean(answers, lambda a: a.right),
        queues=_mean(answers, lambda a: a.queues),
        listed=_mean(answers, lambda a: a.listed),
        listed_in_order=_mean(answers, lambda a: a.listed_in_order),
    )


def _mean(answers: Sequence[Answer], of: Callable[[Answer], float]) -> float:
    return statistics.fmean(of(a) for a in answers)
