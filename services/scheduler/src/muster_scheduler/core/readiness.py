"""What keeps a task from starting, and the indexes that find it again when that goes away.

Nothing here looks at all tasks: a robot, a type or an object leads to those that wait for it, first come first.
"""

from muster_schemas.mission import MissionStatus, TaskStatus

from .effects import LookFor
from .queue import WaitQueue
from .state import Mission, Presence, Robot, Task
from .turn import Turn

FIRST_WAITERS = 8
"""So many tasks at the front of a queue are looked at when a robot changes hands."""
LISTED_DEPENDENCIES = 50


def refresh(turn: Turn, task: Task) -> None:
    """Bring a task's `waiting_for` and its places in the indexes up to date; put it on the agenda if it may start."""
    state = turn.state
    mission = state.missions[task.mission_id]
    may_run = mission.state is MissionStatus.RUNNING and not mission.cancelling
    held = task.hold_until is not None and task.hold_until > turn.now
    if task.state is TaskStatus.READY and may_run and task.awaits is None:
        _watch_objects(turn, task)
        if task.missing or held:
            leave_queues(turn, task)
        else:
            _join_queues(turn, task)
            state.agenda.tasks[task.key] = None
    elif task.state is TaskStatus.READY:
        stop_waiting(turn, task)
    set_waiting(turn, task)


def set_waiting(turn: Turn, task: Task) -> None:
    """Say what the task waits for."""
    waiting = _reasons(turn, task)
    if waiting != task.waiting_for:
        task.waiting_for = waiting
        turn.touch(task)


def _reasons(turn: Turn, task: Task) -> tuple[str, ...]:
    mission = turn.state.missions[task.mission_id]
    if task.state.ended:
        return ()
    if mission.state is MissionStatus.AWAITING_APPROVAL:
        return ("approval",)
    if task.active:
        return _reasons_of_running(turn, task)
    return _reasons_of_waiting(task) if task.state is TaskStatus.WAITING else _reasons_of_ready(turn, mission, task)


def _reasons_of_waiting(task: Task) -> tuple[str, ...]:
    listed = [f"dependency: {d}" for d in task.dependencies if d in task.unmet]
    more = len(listed) - LISTED_DEPENDENCIES
    return (*listed[:LISTED_DEPENDENCIES], *([f"dependency: {more} more"] if more > 0 else ()))


def _reasons_of_ready(turn: Turn, mission: Mission, task: Task) -> tuple[str, ...]:
    if mission.state is MissionStatus.PAUSED or task.awaits is not None:
        return ("resume" if task.awaits is None else f"{task.awaits}: {task.error}",)
    if task.missing:
        return tuple(f"object: {o}" for o in sorted(task.missing))
    if task.hold_until is not None and task.hold_until > turn.now:
        return (task.no_room or f"retry: {task.error}",)
    if task.kept_for is not None:
        return (task.kept_for,)
    if not task.robots and task.selector is not None:
        return (f"robot: {task.selector.name}",)
    robots = tuple(_named(turn, r) for r in task.robots if not _first_for(turn, task, r))
    return robots or ((task.no_room,) if task.no_room else ())


def _reasons_of_running(turn: Turn, task: Task) -> tuple[str, ...]:
    waiting: list[str] = []
    for run in task.runs.values():
        robot = turn.state.robots[run.robot_id]
        if run.over:
            continue
        if robot.presence is Presence.OFFLINE:
            waiting.append(f"robot: {run.robot_id} (lost; what it does is unknown)")
        elif robot.stopped and not task.is_rule:
            waiting.append(_named(turn, run.robot_id))
        elif task.closing is not None:
            waiting.append(f"robot: {run.robot_id} (to stop)")
        elif run.state is None:
            waiting.append(f"robot: {run.robot_id} (to answer)")
    return tuple(waiting)


def _named(turn: Turn, robot_id: str) -> str:
    robot = turn.state.robots.get(robot_id)
    return f"robot: {robot_id} (stopped)" if robot is not None and robot.stopped else f"robot: {robot_id}"


def _first_for(turn: Turn, task: Task, robot_id: str) -> bool:
    robot = turn.state.robots.get(robot_id)
    if robot is None or robot.presence is not Presence.ONLINE:
        return False
    if task.is_rule:
        return True
    queue = turn.state.wanting_robot.get(robot_id)
    return robot.free and (queue is None or queue.first(1) in ([], [task.key]))


def _watch_objects(turn: Turn, task: Task) -> None:
    state = turn.state
    wanted = task.objects if task.needs_objects else ()
    for name in wanted:
        state.wanting_object.setdefault(name, {})[task.key] = None
    missing = {o for o in wanted if o not in state.objects}
    if missing and not task.missing:
        task.give_up_at = turn.now + state.policy.object_wait_s
        turn.wake_at(task.give_up_at, task)
    if task.missing and not missing:
        task.give_up_at = None
    if missing - task.missing:
        turn.effects.append(LookFor(objects=tuple(sorted(missing))))
    task.missing = missing


def _join_queues(turn: Turn, task: Task) -> None:
    state = turn.state
    if task.robots:
        for robot_id in task.robots:
            state.wanting_robot.setdefault(robot_id, WaitQueue()).add(task.order, task.key)
    elif task.selector is not None:
        for robot_type in task.selector.types or ("",):
            state.wanting_type.setdefault(robot_type, WaitQueue()).add(task.order, task.key)


def leave_queues(turn: Turn, task: Task) -> None:
    """Take a task out of every queue for robots."""
    state = turn.state
    for index, names in (
        (state.wanting_robot, task.robots),
        (state.wanting_type, task.selector.types or ("",) if task.selector is not None else ()),
    ):
        for name in names:
            queue = index.get(name)
            if queue is not None:
                queue.remove(task.key)
                if not queue.waiting:
                    del index[name]


def stop_waiting(turn: Turn, task: Task) -> None:
    """Take a task out of every index: it starts, or it ends without having started."""
    leave_queues(turn, task)
    for name in task.objects:
        waiting = turn.state.wanting_object.get(name, {})
        waiting.pop(task.key, None)
        if not waiting:
            turn.state.wanting_object.pop(name, None)
    task.missing = set()
    task.hold_until = None
    task.give_up_at = None
    task.no_room = None
    task.kept_until = task.kept_for = None


def bind(turn: Turn, mission: Mission, task: Task) -> None:
    """Give a task the robots that its selector is bound to in this mission, if it is."""
    if task.selector is None or task.robots or task.selector.name not in mission.bound:
        return
    leave_queues(turn, task)
    task.robots = tuple(dict.fromkeys((*task.named, *mission.bound[task.selector.name])))
    turn.touch(task)


def robot_changed(turn: Turn, robot: Robot) -> None:
    """Tell those at the front of its queue that a robot was taken, given back, came or went."""
    robot_id = robot.card.robot_id
    turn.state.agenda.robots[robot_id] = None
    queue = turn.state.wanting_robot.get(robot_id)
    for key in queue.first(FIRST_WAITERS) if queue else ():
        task = turn.state.task(key)
        if task is not None:
            set_waiting(turn, task)


def fleet_changed(turn: Turn, robot: Robot) -> None:
    """Tell those that a robot is there for or not: besides its own queue, whoever may still choose among its type."""
    robot_changed(turn, robot)
    state = turn.state
    for index, name in (
        (state.wanting_robot, robot.card.robot_id),
        (state.wanting_type, robot.card.type),
        (state.wanting_type, ""),
    ):
        queue = index.get(name)
        state.agenda.missions |= dict.fromkeys(m for m, _ in (queue.first(FIRST_WAITERS) if queue else ()))
