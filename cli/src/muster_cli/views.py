"""How missions, tasks and plans look in a terminal."""

import time
from collections.abc import Iterable

from muster_schemas.mission import MissionStatus, MissionView, TaskState, TaskStatus
from muster_schemas.plan import Plan
from muster_schemas.skills import PAPER_CATALOGUE
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

_COLOURS: dict[str, str] = {
    "waiting": "dim",
    "ready": "cyan",
    "dispatched": "cyan",
    "running": "yellow",
    "paused": "magenta",
    "succeeded": "green",
    "failed": "bold red",
    "rejected": "bold red",
    "cancelled": "red",
    "skipped": "dim red",
    "planning": "cyan",
    "awaiting_approval": "magenta",
}


def state_text(state: MissionStatus | TaskStatus) -> Text:
    """Return a state in its colour."""
    return Text(state.value.replace("_", " "), style=_COLOURS[state.value])


def seconds(value: float) -> str:
    """Return a time span such as `48 s` or `2 min 05 s`."""
    whole = int(value)
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60:02d} s"


def elapsed(began: float | None, ended: float | None, now: float) -> str:
    """Return how long something has taken, or took; empty if it has not begun."""
    return "" if began is None else seconds(max(0.0, (now if ended is None else ended) - began))


def short_robot(robot_id: str) -> str:
    """Return a robot's id without what all of them have."""
    return robot_id.removeprefix("robot_")


def short_skill(skill: str) -> str:
    """Return the verb of a skill, with `all` for the whole fleet; an unknown one as it is."""
    if skill not in PAPER_CATALOGUE:
        return skill
    entry = PAPER_CATALOGUE[skill]
    return f"{entry.verb} (all)" if entry.fleet_wide else entry.verb


def mission_table(view: MissionView, now: float | None = None) -> RenderableType:
    """Return a mission with its tasks: state, robots, what each waits for, and how long it has taken."""
    at = time.time() if now is None else now
    mission = view.mission
    head = Text.assemble(
        (mission.mission_id, "bold"), "  ", state_text(mission.state), "  ",
        elapsed(mission.created_at, mission.ended_at, at), "\n", (mission.text, "italic"),
    )  # fmt: skip
    parts: list[RenderableType] = [head]
    parts += [Text(f"  {_where(r.task)}{r.message}", style="red") for r in mission.reasons]
    if view.tasks:
        parts.append(_tasks(view.tasks, at))
    return Group(*parts)


def _where(task: str | None) -> str:
    return f"{task}: " if task else ""


def _tasks(tasks: Iterable[TaskState], now: float) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("task", "skill", "at", "robots", "state", "time", "waits for"):
        table.add_column(column, overflow="fold")
    for task in tasks:
        why = task.error or ", ".join(task.waiting_for)
        if task.state is TaskStatus.RUNNING and not why and 0 < task.progress < 1:
            why = f"{task.progress:.0%} done"
        table.add_row(
            task.task_id,
            short_skill(task.skill),
            ", ".join(task.objects),
            ", ".join(short_robot(r) for r in task.robots),
            state_text(task.state),
            elapsed(task.started_at, task.ended_at, now),
            Text(why, style="red" if task.error else "dim"),
        )
    return table


def missions_table(views: Iterable[MissionView], now: float | None = None) -> Table:
    """Return one line for each mission."""
    at = time.time() if now is None else now
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("mission", "state", "time", "tasks done", "instruction"):
        table.add_column(column, overflow="fold")
    for view in views:
        m = view.mission
        done = sum(t.state is TaskStatus.SUCCEEDED for t in view.tasks)
        table.add_row(
            m.mission_id,
            state_text(m.state),
            elapsed(m.created_at, m.ended_at, at),
            f"{done} of {len(view.tasks)}" if view.tasks else "",
            escape(m.text if len(m.text) <= 80 else m.text[:79] + "…"),
        )
    return table


def plan_table(plan: Plan) -> Table:
    """Return a plan as a table; tasks have the ids that they get in a mission."""
    ids = {task.task: f"t{number}" for number, task in enumerate(plan.tasks, start=1)}
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("task", "skill", "at", "robots", "after"):
        table.add_column(column, overflow="fold")
    for task in plan.tasks:
        f = task.instruction_function
        if f.robot_ids:
            robots = ", ".join(short_robot(r) for r in f.robot_ids)
        elif f.robot_type:
            robots = f"{f.robot_count or 1} {' / '.join(f.robot_type)}"
        else:
            robots = "all"
        table.add_row(
            ids[task.task],
            short_skill(f.name),
            ", ".join(f.object_keywords),
            robots,
            ", ".join(ids.get(name, name) for name in f.dependencies),
        )
    return table


def bars(tasks: Iterable[TaskState], width: int = 48) -> Table:
    """Return when each task ran, as bars over one time axis, so that parallel work is seen at a glance."""
    ran = [t for t in tasks if t.started_at is not None]
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("task")
    table.add_column("robots")
    if not ran:
        return table
    begin = min(t.started_at or 0.0 for t in ran)
    end = max(t.ended_at or t.started_at or 0.0 for t in ran)
    scale = width / max(end - begin, 1e-9)
    table.add_column(f"0 s{seconds(end - begin):>{max(width - 3, 0)}}", no_wrap=True)
    for task in sorted(ran, key=lambda t: t.started_at or 0.0):
        first = int(((task.started_at or begin) - begin) * scale)
        last = max(first + 1, round(((task.ended_at or end) - begin) * scale))
        bar = Text(" " * first + "━" * (last - first), style=_COLOURS[task.state.value])
        what = " ".join((short_skill(task.skill), *task.objects))
        table.add_row(what, ", ".join(short_robot(r) for r in task.robots), bar)
    return table
