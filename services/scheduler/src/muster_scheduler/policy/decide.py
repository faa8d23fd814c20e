"""From the agenda to decisions: which ready tasks start now, with which robots."""

from collections.abc import Iterator

from muster_schemas.mission import TaskStatus

from muster_scheduler.core.core import Core
from muster_scheduler.core.effects import Effect
from muster_scheduler.core.events import AnyEvent, SelectorBound, TaskDeferred
from muster_scheduler.core.queue import TaskKey
from muster_scheduler.core.state import Agenda, Presence, State, Task

from .assignment import Assignment
from .binding import bind
from .placing import decide_start
from .world import World

LOOK_AGAIN_S = 30.0
"""A task that is put off for the sake of others is looked at again after so long at the latest."""
LOOKED_AT = 8
"""So many tasks at the front of a robot's queue may overtake one that still waits for another robot."""


def advance(
    core: Core, event: AnyEvent, world: World, assignment: Assignment
) -> tuple[list[AnyEvent], list[Effect]]:  # fmt: skip
    """Handle one event and all decisions that follow from it.

    Returns:
        the events for the journal, in order, and the effects that may go out once they are in it.

    """
    events = [event]
    effects = core.handle(event)
    while core.state.agenda:
        for decision in decide(core.state, core.take_agenda(), world, assignment, core.state.now):
            effects += core.handle(decision)
            events.append(decision)
    return events, effects


def decide(state: State, agenda: Agenda, world: World, assignment: Assignment, at: float) -> Iterator[AnyEvent]:
    """Yield the decisions of one look at the agenda. The caller handles each before it asks for the next one.

    So each place is chosen knowing the ones given a moment before. The caller looks again until the agenda is empty.
    """
    tasks = sorted(_candidates(state, agenda, assignment), key=assignment.rank)
    first = next((t for t in tasks if not t.robots or _can_start(state, t, at)), None)
    if assignment.review(state, world, agenda.missions, first, at):
        tasks.sort(key=assignment.rank)
    unplanned: list[Task] = []
    for task in tasks:
        team = task.robots or assignment.team(state, task, at)
        if not team:
            unplanned.append(task)
        elif all(o in world.objects for o in _needed(task)) or not task.robots:
            yield from _begin(state, world, assignment, task, team, at)
    yield from bind(state, world, [t for t in unplanned if t.state is TaskStatus.READY and not t.robots], set(), at)


def _begin(
    state: State, world: World, assignment: Assignment, task: Task, team: tuple[str, ...], at: float
) -> Iterator[AnyEvent]:  # fmt: skip
    """Yield that a task starts, with the robots that its selector should mean; or why it had better wait."""
    if not all(_is_available(state, r, task, at) for r in team):
        if not task.robots:
            yield from _deferred(task, at + LOOK_AGAIN_S, at)
        return
    insists = task.is_rule or (len(team) > 1 and any(_claimant(state, r, at) is task for r in team))
    keep = None if insists else assignment.keep(state, world, task, team, at)
    if keep is not None:
        other = "/".join(keep.for_task)
        until = at + min(max(keep.until_s, 1.0), LOOK_AGAIN_S)
        yield from _deferred(task, until, at, f"robot: {keep.robot_id} (kept for {other})")
        return
    if not task.robots and task.selector is not None:
        robots = tuple(r for r in team if r not in task.named)
        yield SelectorBound(at=at, mission_id=task.mission_id, selector=task.selector.name, robots=robots)
    if all(o in world.objects for o in _needed(task)) and _is_queued(state, task) and _can_start(state, task, at):
        yield decide_start(state, world, task, at)


def _deferred(task: Task, until: float, at: float, why: str = "") -> Iterator[TaskDeferred]:
    why = why or f"robot: {task.selector.name if task.selector else 'busy'}"
    if task.kept_until is None or task.kept_until <= at or task.kept_for != why:
        yield TaskDeferred(at=at, mission_id=task.mission_id, task_id=task.task_id, until=until, waiting_for=why)


def _needed(task: Task) -> tuple[str, ...]:
    return task.objects if task.needs_objects else ()


def _candidates(state: State, agenda: Agenda, assignment: Assignment) -> Iterator[Task]:
    keys: dict[TaskKey, None] = dict(agenda.tasks)
    for robot_id in agenda.robots:
        robot = state.robots[robot_id]
        if robot.presence is not Presence.ONLINE:
            continue
        for index, name in (
            (state.wanting_robot, robot_id),
            (state.wanting_type, robot.card.type),
            (state.wanting_type, ""),
        ):
            queue = index.get(name)
            keys |= dict.fromkeys(queue.first(LOOKED_AT) if queue else ())
        keys |= dict.fromkeys(assignment.next_for(state, robot_id, LOOKED_AT))
    for key in keys:
        task = state.task(key)
        if task is not None and task.state is TaskStatus.READY and _is_queued(state, task):
            yield task


def _is_queued(state: State, task: Task) -> bool:
    """Return whether nothing but robots keeps the task from starting; the core keeps the queues so."""
    if task.robots:
        queue = state.wanting_robot.get(task.robots[0])
    else:
        types = task.selector.types if task.selector else ()
        queue = state.wanting_type.get(types[0] if types else "")
    return queue is not None and task.key in queue.waiting


def _can_start(state: State, task: Task, at: float) -> bool:
    """Return whether a task may have all of its robots now."""
    return bool(task.robots) and all(_is_available(state, r, task, at) for r in task.robots)


def _is_available(state: State, robot_id: str, task: Task, at: float) -> bool:
    robot = state.robots.get(robot_id)
    if robot is None or robot.presence is not Presence.ONLINE:
        return False
    return task.is_rule or (robot.free and not _is_claimed(state, robot_id, task, at))


def _is_claimed(state: State, robot_id: str, task: Task, at: float) -> bool:
    """Return whether a robot is kept for a team that comes before this task."""
    claimant = _claimant(state, robot_id, at)
    return claimant is not None and claimant.key != task.key and claimant.order < task.order


def _claimant(state: State, robot_id: str, at: float) -> Task | None:
    """Return the team task that is first in a robot's queue and has waited so long that nothing may overtake it.

    All queues are in the same order, so the most urgent of those that wait is first everywhere: none wait for ever.
    """
    queue = state.wanting_robot.get(robot_id)
    for key in queue.first(1) if queue else ():
        first = state.task(key)
        if first is None or first.is_rule or len(first.robots) < 2:
            return None
        team = [state.robots.get(r) for r in first.robots]
        has_waited = at - (first.ready_at or at) >= state.policy.ageing_s / 2
        return first if has_waited and all(r is not None and r.in_service for r in team) else None
    return None
