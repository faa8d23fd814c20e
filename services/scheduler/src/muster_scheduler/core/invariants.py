"""What must hold after every event; tests check it, and it says in one place what the indexes mean."""

from collections.abc import Iterator

from muster_schemas.mission import MissionStatus, TaskStatus

from .state import Awaits, Mission, State, Task


def validate(state: State) -> None:
    """Check the whole state. Looks at everything, so it is for tests only.

    Raises:
        AssertionError: the state contradicts itself; the message lists how.

    """
    problems = list(_problems(state))
    if problems:
        raise AssertionError("; ".join(problems))


def _problems(state: State) -> Iterator[str]:
    for mission in state.missions.values():
        yield from _mission(state, mission)
        for task in mission.tasks.values():
            for problem in _task(state, mission, task):
                yield f"{task.mission_id}/{task.task_id} ({task.state}): {problem}; {'; '.join(task.story)}"
    yield from _robots(state)
    yield from _queues(state)


def _mission(state: State, mission: Mission) -> Iterator[str]:
    name = mission.mission_id
    tasks = mission.tasks.values()
    if mission.open_tasks != sum(not t.state.ended for t in tasks):
        yield f"{name} miscounts its open tasks"
    if mission.active != {t.task_id for t in tasks if t.active}:
        yield f"{name} mistakes which tasks are active"
    if mission.unsuccessful != sum(
        t.state.ended and t.state is not TaskStatus.SUCCEEDED and not t.excused for t in tasks
    ):
        yield f"{name} miscounts what did not succeed"
    if mission.state.ended and mission.open_tasks:
        yield f"{name} is {mission.state} with open tasks"
    if mission.state in (MissionStatus.RUNNING, MissionStatus.PAUSED) and not mission.open_tasks:
        yield f"{name} is {mission.state} with nothing left to do"
    if mission.state is MissionStatus.SUCCEEDED and mission.unsuccessful:
        yield f"{name} succeeded although tasks did not"
    if [s for s, ids in state.by_state.items() if name in ids] != [mission.state]:
        yield f"{name} is listed under another state than {mission.state}"
    if mission.state in (MissionStatus.PLANNING, MissionStatus.AWAITING_APPROVAL) and mission.active:
        yield f"{name} has begun before it may"


def _task(state: State, mission: Mission, task: Task) -> Iterator[str]:
    unmet = {d for d in task.dependencies if not _counts_as_done(mission.tasks[d])}
    if task.unmet != unmet:
        yield f"says that it still waits for {sorted(task.unmet)}, not {sorted(unmet)}"
    begun = task.active or task.state in (TaskStatus.READY, TaskStatus.SUCCEEDED, TaskStatus.FAILED)
    if begun and unmet:
        yield f"goes on before {sorted(unmet)}"
    if task.state is TaskStatus.WAITING and not unmet and mission.state is MissionStatus.RUNNING:
        yield "waits for nothing"
    if task.active:
        yield from _attempt(state, task)
    may_wait = not task.state.ended and not task.active and mission.state is not MissionStatus.PLANNING
    if may_wait and not task.waiting_for and task.key not in state.agenda.tasks:
        yield "does not say what it waits for"
    if task.awaits is not None and (task.state is not TaskStatus.READY or not task.error):
        yield f"awaits {task.awaits} without having failed"
    if (task.awaits is Awaits.APPROVAL) != (task.proposal is not None):
        yield "awaits approval of no plan, or has one that nobody is to approve"
    if task.state.ended and task.waiting_for:
        yield "has ended and waits"
    if task.state is TaskStatus.SUCCEEDED and any(not r.over for r in task.runs.values()):
        yield "succeeded before all of its robots did"


def _counts_as_done(task: Task) -> bool:
    return task.state is TaskStatus.SUCCEEDED or task.waived


def _attempt(state: State, task: Task) -> Iterator[str]:
    if set(task.runs) != set(task.robots):
        yield "is not run by its robots"
    if all(r.over for r in task.runs.values()) and not task.is_rule:
        yield "is active although all of its robots are done"
    for run in task.runs.values():
        if not task.is_rule and state.robots[run.robot_id].holder != task.key:
            yield f"does not hold {run.robot_id}"
        if run.over and run.asked is not None:
            yield f"still asks {run.robot_id}"


def _robots(state: State) -> Iterator[str]:
    for robot_id, robot in state.robots.items():
        holder = state.task(robot.holder) if robot.holder else None
        if robot.holder and (holder is None or not holder.active or robot_id not in holder.runs):
            yield f"{robot_id} is held by {robot.holder}, which does not use it"
        for key, loose in robot.loose_ends.items():
            task = state.task(key)
            if task is None or (task.active and task.attempt == loose.ref.attempt and not task.runs[robot_id].over):
                yield f"{robot_id} has a loose end at {key}, which is still being run"


def _queues(state: State) -> Iterator[str]:
    queued = {key for index in (state.wanting_robot, state.wanting_type) for q in index.values() for key in q.waiting}
    eligible = {
        t.key
        for m in state.missions.values()
        if m.state is MissionStatus.RUNNING and not m.cancelling
        for t in m.tasks.values()
        if t.state is TaskStatus.READY
        and not t.missing
        and t.awaits is None
        and (t.hold_until is None or t.hold_until <= state.now)
    }
    # a hold that is just over is noticed by the tick that it has set
    late = {t.key for m in state.missions.values() for t in m.tasks.values() if t.hold_until is not None}
    if queued - eligible or eligible - queued - late:
        yield f"queues hold {sorted(queued - eligible)} too many and {sorted(eligible - queued - late)} too few"
    for name, queue in state.wanting_robot.items():
        for key in queue.waiting:
            task = state.task(key)
            if task is None or name not in task.robots:
                yield f"{key} waits for {name}, which it does not want"
