"""`muster plan`: plans without a running site, for one instruction or a whole file of them."""

import json
from pathlib import Path

from muster_schemas.site import Site
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from .errors import CliError
from .views import plan_table


def plan_text(text: str, site: Site, planner: str, *, as_json: bool, console: Console) -> None:
    """Print the plan for one instruction.

    Raises:
        CliError: the model cannot be had, or the instruction cannot be done here.

    """
    offline, published, setup_error = _planner()
    try:
        answer = offline.plan_one(text, site=site, planner=planner)
    except setup_error as error:
        raise CliError(str(error), 2) from error
    if answer.plan is None:
        raise CliError(answer.error or "There is no plan for that.")
    if as_json:
        print(json.dumps(published.published_form(answer.plan), indent=2))  # noqa: T201
    else:
        console.print(plan_table(answer.plan))


def plan_file(source: Path, target: Path, site: Site, planner: str) -> None:
    """Plan a file of instructions with a progress bar on standard error.

    Raises:
        CliError: the model cannot be had, or a file cannot be read or written.

    """
    offline, _, setup_error = _planner()
    columns = (TextColumn("planning"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    try:
        with Progress(*columns, console=Console(stderr=True)) as progress:
            bar = progress.add_task("planning", total=None)

            def show(done: int, total: int) -> None:
                progress.update(bar, completed=done, total=total)

            summary = offline.plan_batch(
                source,
                target,
                site=site,
                planner=planner,
                progress=show,
            )
    except setup_error as error:
        raise CliError(str(error), 2) from error
    except OSError as error:
        raise CliError(f"{error.filename}: {error.strerror}", 2) from error
    print(f"{summary.planned} of {summary.lines} instructions have a plan: {target}")  # noqa: T201


def _planner():
    """Import the planner only when it is asked for: the command also runs where it is not installed."""
    try:
        from muster_planner import offline, published  # noqa: PLC0415
        from muster_planner.errors import SetupError  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise CliError("The planner is not installed here; plans need the package muster-planner.", 2) from error
    return offline, published, SetupError
