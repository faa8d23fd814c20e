"""From the agenda to decisions: which ready tasks start now, with which robots."""

from collections.abc import Iterator

from muster_schemas.mission import TaskStatus

from muster_scheduler.core.core import Core
from muster_scheduler.core.effects import Effect
from muster_scheduler.core.events import AnyEvent
from muster_scheduler.core.queue import TaskKey
from muster_scheduler.core.state import Agenda, Presence, State, Task

from .binding import PATIENCE_S, bind
from .placing import decide_start
from .world import World

LOOKED_AT = 8
"""So many tasks at the front of a robot's queue may overtake one that still waits for another robot."""


def advance(core: Core, event: AnyEvent, world: World) -> tuple[list[AnyEvent], list[Effect]]:
    """Handle one event and all decisions that follow from it.

    Returns:
        the events for the journal, in order, and the effects that may go out once they are in it.

    """
    events = [event]
    effects = core.handle(event)
    while core.state.agenda:
        for decision in decide(core.state, core.take_agenda(), world, core.state.now):
            effects += core.handle(decision)
            events.append(decision)
    return events, effects


def decide(state: State, agenda: Agenda, world: World, at: float) -> Iterator[AnyEvent]:
    """Yield the decisions of one look at the agenda. The caller handles each before it asks for the next one.

    So each place is chosen knowing the ones given a moment before. The caller looks again until the agenda is empty.
    """
    tasks = sorted(_candidates(state, agenda), key=lambda t: t.order)
    taken: set[str] = set()
    for task in tasks:
        startable = task.state is TaskStatus.READY and task.robots and _can_start(state, task, taken, at)
        if startable and all(o in world.objects for o in _needed(task)):
            yield decide_start(state, world, task, at)
            if not task.is_rule:
                taken |= set(task.robots)
    yield from bind(state, world, [t for t in tasks if t.state is TaskStatus.READY and not t.robots], taken, at)


def _needed(task: Task) -> tuple[str, ...]:
    return task.objects if task.needs_objects else ()


def _candidates(state: State, agenda: Agenda) -> Iterator[Task]:
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


def _can_start(state: State, task: Task, taken: set[str], at: float) -> bool:
    """Return whether a task may have all of its robots now."""
    for robot_id in task.robots:
        robot = state.robots.get(robot_id)
        if robot is None or robot.presence is not Presence.ONLINE:
            return False
        if task.is_rule:
            continue
        if not robot.free or robot_id in taken or _is_claimed(state, robot_id, task, at):
            return False
    return True


def _is_claimed(state: State, robot_id: str, task: Task, at: float) -> bool:
    """Return whether a robot is kept for the first in its queue, which has waited long for its whole team.

    All queues are in the same order, so the most urgent of those that wait is first everywhere: none wait for ever.
    """
    queue = state.wanting_robot.get(robot_id)
    for key in queue.first(1) if queue else ():
        first = state.task(key)
        if first is None or first.key == task.key or first.order > task.order or first.is_rule:
            return False
        team = [state.robots.get(r) for r in first.robots]
        has_waited = at - (first.ready_at or at) >= PATIENCE_S
        return has_waited and all(r is not None and r.presence is Presence.ONLINE and not r.stopped for r in team)
    return False
