"""Following one mission to its end, with live progress. Ends without touching the mission when interrupted."""

import time
from collections.abc import Iterator

from muster_schemas.mission import MissionStatus, MissionView
from rich.console import Console
from rich.live import Live
from rich.prompt import Confirm

from .errors import CliError
from .rest import OperatorApi, Unreachable
from .views import mission_table, plan_table, short_robot, short_skill

_POLL_S = 0.3
_GONE_S = 60.0
"""How long the interface may be away (it is started again after a crash) before following ends."""


def follow(api: OperatorApi, mission_id: str, console: Console) -> MissionView:
    """Show a mission until it has ended and return it; on a terminal, a plan that awaits approval is asked about.

    Raises:
        CliError: the mission is unknown, or the interface stays away.

    """
    view = api.mission(mission_id)
    if not console.is_terminal:
        news = _News(console)
        for view in _changes(api, mission_id):
            news.tell(view)
        return view
    while not view.mission.state.ended:
        if view.mission.state is MissionStatus.AWAITING_APPROVAL and console.is_interactive:
            _ask(api, view, console)
        with Live(mission_table(view), console=console, auto_refresh=False) as live:
            for view in _changes(api, mission_id):
                live.update(mission_table(view), refresh=True)
                if view.mission.state is MissionStatus.AWAITING_APPROVAL and console.is_interactive:
                    break
    return view


def _changes(api: OperatorApi, mission_id: str) -> Iterator[MissionView]:
    """Yield the mission at each look, until it has ended."""
    away_since: float | None = None
    while True:
        try:
            view = api.mission(mission_id)
            away_since = None
        except Unreachable:
            away_since = away_since or time.monotonic()
            if time.monotonic() - away_since > _GONE_S:
                raise
            time.sleep(_POLL_S)
            continue
        yield view
        if view.mission.state.ended:
            return
        time.sleep(_POLL_S)


def _ask(api: OperatorApi, view: MissionView, console: Console) -> None:
    if view.plan:
        console.print(plan_table(view.plan))
    yes = Confirm.ask("Run this plan?", console=console, default=True)
    try:
        api.act(view.mission.mission_id, "approve" if yes else "reject")
    except CliError as error:
        console.print(str(error), style="red")


class _News:
    """Prints a line for each thing whose state has changed, for logs and pipes."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._told: dict[str, str] = {}

    def tell(self, view: MissionView) -> None:
        mission = view.mission
        self._once("", f"{mission.mission_id} {mission.state.value}")
        for task in view.tasks:
            robots = ", ".join(short_robot(r) for r in task.robots)
            what = " ".join((short_skill(task.skill), *task.objects))
            decision = next((w for w in task.waiting_for if w.startswith("decision: ")), None)
            error = f" ({task.error})" if task.error else ""
            if decision is not None:
                error += f"; say muster retry, skip or replan {task.mission_id} {task.task_id}, or muster cancel"
            self._once(task.task_id, f"  {task.name}: {what} [{robots}] {task.state.value}{error}")
        for number, reason in enumerate(mission.reasons):
            self._once(f"reason {number}", f"  {reason.message}")

    def _once(self, what: str, line: str) -> None:
        if self._told.get(what) != line:
            self._told[what] = line
            self._console.print(line, markup=False, highlight=False, soft_wrap=True)
