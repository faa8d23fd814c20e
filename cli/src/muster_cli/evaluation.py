"""`muster evaluate`: how well a planner plans a data set, without a running site."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from muster_schemas.site import Site
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from .errors import CliError

if TYPE_CHECKING:
    from muster_planner.evaluation.measures import Answer, Evaluation

Method = Literal["dart-llm", "smart-llm"]


@dataclass(frozen=True)
class Asked:
    """What is to be evaluated, and what becomes of the result."""

    dataset: Path
    site: Site
    planner: str
    method: Method
    dependencies: bool
    repeat: int
    limit: int | None
    failures: bool
    out: Path | None


def evaluate(asked: Asked, console: Console) -> None:
    """Plan every case with a progress bar on standard error, then print the tables and write the files.

    Raises:
        CliError: the data set cannot be read, the model not be had, or a file not be written.

    """
    try:
        from muster_planner.errors import SetupError  # noqa: PLC0415 (the command also runs without the planner)
        from muster_planner.evaluation import measures, picture, report  # noqa: PLC0415
        from muster_planner.evaluation.cases import DatasetError  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise CliError(
            "The planner is not installed here; to evaluate it takes the package muster-planner.", 2
        ) from error
    try:
        if asked.out:
            _writable(asked.out)
            picture.require()
        answers, complete = _answers(asked)
        if not answers:
            raise CliError("Stopped before the first answer.", 130)
        result = measures.summarise(
            answers,
            dataset=asked.dataset.name,
            planner=asked.planner,
            method=asked.method,
            dependencies=asked.dependencies,
            repeat=asked.repeat,
            limit=asked.limit,
            complete=complete,
        )
        _show(result, console)
        if asked.failures:
            for answer in result.failures:
                console.print(report.failure(answer), markup=False, highlight=False, soft_wrap=True)
        if asked.out:
            _target(asked.out, "json").write_text(result.model_dump_json(indent=1) + "\n", encoding="utf-8")
            _target(asked.out, "md").write_text(report.markdown(result), encoding="utf-8")
            picture.draw(result, _target(asked.out, "png"))
            console.print(f"Written: {asked.out}.json, .md, .png", highlight=False, soft_wrap=True)
    except (SetupError, DatasetError) as error:
        raise CliError(str(error), 2) from error
    except OSError as error:
        raise CliError(f"{error.filename}: {error.strerror}", 2) from error


def _target(out: Path, ending: str) -> Path:
    return out.with_name(f"{out.name}.{ending}")


def _writable(out: Path) -> None:
    """Find out before the long work whether its result can be kept."""
    out.parent.mkdir(parents=True, exist_ok=True)
    if not os.access(out.parent, os.W_OK) or any(_target(out, e).is_dir() for e in ("json", "md", "png")):
        raise CliError(f"Nothing can be written as {out}. Give --out another name.", 2)


def _answers(asked: Asked) -> "tuple[list[Answer], bool]":
    """Return the answers, and whether all cases were asked; Ctrl-C keeps what there is."""
    from muster_planner.evaluation.cases import read_cases  # noqa: PLC0415
    from muster_planner.evaluation.running import Judge, chosen  # noqa: PLC0415
    from muster_planner.evaluation.smart_llm import SmartLlm  # noqa: PLC0415
    from muster_planner.offline import open_offline  # noqa: PLC0415
    from muster_planner.surroundings import Surroundings  # noqa: PLC0415

    there = Surroundings.of_file(asked.site)
    cases = chosen(read_cases(asked.dataset, there), asked.limit)
    answers: list[Answer] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    wrap = SmartLlm if asked.method == "smart-llm" else None
    with (
        open_offline(asked.site, asked.planner, wrap=wrap) as planner,
        Progress(*columns, console=Console(stderr=True)) as progress,
    ):
        bar = progress.add_task("planning", total=len(cases) * asked.repeat)
        judge = Judge(there, dependencies=asked.dependencies)
        try:
            for answer in judge.answers(cases, planner, repeat=asked.repeat):
                answers.append(answer)
                right = sum(a.right for a in answers)
                progress.update(bar, advance=1, description=f"planning, {right} of {len(answers)} right")
        except KeyboardInterrupt:
            return answers, False
    return answers, True


def _show(result: "Evaluation", console: Console) -> None:
    from muster_planner.evaluation import report  # noqa: PLC0415

    console.print(report.title(result), style="bold", highlight=False)
    console.print(_table(report.HEAD, report.table(result)))
    console.print()
    console.print("SR with and without the plans' dependencies", style="bold")
    console.print(_table(report.ABLATION_HEAD, report.ablation_table(result)))
    console.print()
    for line in report.summary(result):
        console.print(line, highlight=False)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in head:
        table.add_column(column, justify="left" if column == "level" else "right")
    for row in rows:
        table.add_row(*row)
    return table
