"""`muster evaluate`: how well a planner plans a data set, without a running site."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from .errors import CliError

Method = Literal["dart-llm", "smart-llm"]


def evaluate(console: Console, *, failures: bool, out: Path | None, **asked: Any) -> None:
    """Plan every case with a progress bar on standard error, then print the tables and write the files.

    Args:
        console: for the tables.
        failures: also list what was wrong, case by case.
        out: name of the files without ending; None: none are written.
        asked: the fields of the planner's `evaluation.evaluating.Asked`.

    Raises:
        CliError: the data set cannot be read, the model not be had, or a file not be written.

    """
    try:
        from muster_planner.errors import SetupError  # noqa: PLC0415 (the command also runs without the planner)
        from muster_planner.evaluation import evaluating, picture, report  # noqa: PLC0415
        from muster_planner.evaluation.cases import DatasetError  # noqa: PLC0415
    except ModuleNotFoundError as error:
        message = "The planner is not installed here; to evaluate it takes the package muster-planner."
        raise CliError(message, 2) from error
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    try:
        if out:
            _writable(out)
            picture.require()
        with Progress(*columns, console=Console(stderr=True)) as progress:
            bar = progress.add_task("planning", total=None)

            def show(right: int, done: int, total: int) -> None:
                progress.update(bar, completed=done, total=total, description=f"planning, {right} of {done} right")

            result = evaluating.evaluate(evaluating.Asked(**asked), show)
        if result is None:
            raise CliError("Stopped before the first answer.", 130)
        console.print(report.title(result), style="bold", highlight=False)
        console.print(_table(report.HEAD, report.table(result)))
        console.print("\nSR with and without the plans' dependencies", style="bold")
        console.print(_table(report.ABLATION_HEAD, report.ablation_table(result)))
        console.print("\n" + "\n".join(report.summary(result)), highlight=False)
        for answer in result.failures if failures else ():
            console.print(report.failure(answer), markup=False, highlight=False, soft_wrap=True)
        if out:
            _target(out, "json").write_text(result.model_dump_json(indent=1) + "\n", encoding="utf-8")
            _target(out, "md").write_text(report.markdown(result), encoding="utf-8")
            picture.draw(result, _target(out, "png"))
            console.print(f"Written: {out}.json, .md, .png", highlight=False, soft_wrap=True)
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


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in head:
        table.add_column(column, justify="left" if column == "level" else "right")
    for row in rows:
        table.add_row(*row)
    return table
