"""Plans become tasks: a mission's first plan, an edited one, and a new one for the rest of it."""

from collections.abc import Iterable, Mapping, Sequence

from muster_schemas.mission import MissionStatus, Reason, TaskStatus
from muster_schemas.plan import PlanTask

from . import outcomes, readiness
from .effects import RetractTask
from .graph import TaskGraph
from .state import Mission, Presence, Selector, State, Task
from .turn import Turn


def set_plan(turn: Turn, mission: Mission, plan: tuple[PlanTask, ...], ask_because: tuple[str, ...]) -> None:
    """Give a mission its plan, or replace the one that waits for approval; begin it unless a person is to see it."""
    for task_id in mission.tasks:
        turn.effects.append(RetractTask(mission_id=mission.mission_id, task_id=task_id))
    first_revision = max((t.revision for t in mission.tasks.values()), default=0)
    mission.plan = plan
    mission.plan_revision += 1
    mission.tasks = _tasks(turn.state, mission, plan, first_number=1, revision=first_revision)
    _index(mission)
    mission.open_tasks = len(mission.tasks)
    mission.reasons = reasons_to_ask(ask_because)
    # an edit that takes away what a rule was about does not start the mission by itself
    waits = mission.approval == "ask" or ask_because or mission.state is MissionStatus.AWAITING_APPROVAL
    to = MissionStatus.AWAITING_APPROVAL if waits else MissionStatus.RUNNING
    if mission.state is not to:
        turn.move_mission(mission, to)
    turn.touch_mission(mission)
    for task in mission.tasks.values():
        turn.touch(task)
    if to is MissionStatus.RUNNING:
        start(turn, mission)
    else:
        begin(turn, mission, mission.tasks.values())


def start(turn: Turn, mission: Mission) -> None:
    """Let a mission have its place among the others from now on, and begin."""
    mission.urgency = turn.now + (9 - mission.priority) * turn.state.policy.ageing_s
    turn.state.agenda.missions[mission.mission_id] = None
    for task in mission.tasks.values():
        task.order = (mission.urgency, *task.order[1:])
    begin(turn, mission, mission.tasks.values())


def reasons_to_ask(because: Iterable[str]) -> tuple[Reason, ...]:
    """Return why the site's policy wants a person to see a plan."""
    return tuple(Reason(code="approval_rule", message=why[:1000]) for why in because)


def begin(turn: Turn, mission: Mission, tasks: Iterable[Task]) -> None:
    """Let those tasks go that depend on nothing, if the mission may run."""
    for task in tasks:
        if mission.state is not MissionStatus.AWAITING_APPROVAL and not task.unmet:
            outcomes.make_ready(turn, mission, task)
        else:
            readiness.set_waiting(turn, task)


def replace_rest(turn: Turn, mission: Mission, failed: Task, plan: Sequence[PlanTask]) -> None:
    """Put a new plan in the place of a task that failed and all that would have come after it.

    What the old tasks had to wait for beside the failed one, the new ones wait for, too.
    """
    old = [failed, *(t for t in _after(mission, failed) if t.state is TaskStatus.WAITING)]
    gone = {t.task_id for t in old}
    wait_for = dict.fromkeys(d for t in old for d in t.dependencies if d in t.unmet and d not in gone)
    _let_go(turn.state, mission, gone)
    for task in old:
        readiness.stop_waiting(turn, task)
        task.excused = True
        task.awaits = task.proposal = None
        task.error = task.error or f"a new plan took its place after {failed.name} failed"
        turn.move(task, TaskStatus.FAILED if task is failed else TaskStatus.SKIPPED, "a new plan takes its place")
    kept = [p for p in mission.plan or () if p.task not in {t.name for t in old}]
    new = _renamed(plan, {t.name for t in mission.tasks.values()})
    added = _tasks(turn.state, mission, new, first_number=len(mission.tasks) + 1, wait_for=tuple(wait_for))
    mission.plan = (*kept, *new)
    mission.plan_revision += 1
    mission.tasks |= added
    mission.open_tasks += len(added)
    _index(mission)
    turn.touch_mission(mission)
    turn.state.agenda.missions[mission.mission_id] = None
    for task in added.values():
        turn.touch(task)
    begin(turn, mission, added.values())


def rest_of(mission: Mission, failed: Task) -> tuple[PlanTask, ...]:
    """Return what was planned to come after a task and has not been begun."""
    names = {t.name for t in _after(mission, failed) if t.state is TaskStatus.WAITING}
    return tuple(p for p in mission.plan or () if p.task in names)


def planned_in(mission: Mission, *states: TaskStatus) -> tuple[PlanTask, ...]:
    """Return the planned form of the tasks in these states."""
    names = {t.name for t in mission.tasks.values() if t.state in states}
    return tuple(p for p in mission.plan or () if p.task in names)


def _after(mission: Mission, task: Task) -> Iterable[Task]:
    return (mission.tasks[t] for t in mission.graph.steps_to(task.task_id))


def _let_go(state: State, mission: Mission, gone: set[str]) -> None:
    """Forget the choice of robots that only replaced tasks used, if one of those robots is not there any more."""
    used = {
        t.selector.name
        for t in mission.tasks.values()
        if t.selector is not None and t.task_id not in gone and not t.state.ended
    }
    for name, robots in list(mission.bound.items()):
        there = all(state.robots[r].presence is Presence.ONLINE for r in robots)
        if name not in used and not there:
            del mission.bound[name]


def _renamed(plan: Sequence[PlanTask], taken: set[str]) -> tuple[PlanTask, ...]:
    """Return the plan with names that no task of the mission has had."""
    names: dict[str, str] = {}
    for task in plan:
        name, number = task.task, 2
        while name in taken:
            name, number = f"{task.task[:58]}_{number}", number + 1
        taken.add(name)
        names[task.task] = name
    return tuple(
        t.model_copy(
            update={
                "task": names[t.task],
                "instruction_function": t.instruction_function.model_copy(
                    update={"dependencies": tuple(names[d] for d in t.instruction_function.dependencies)}
                ),
            }
        )
        for t in plan
    )


def _tasks(
    state: State,
    mission: Mission,
    plan: Sequence[PlanTask],
    *,
    first_number: int,
    revision: int = 0,
    wait_for: tuple[str, ...] = (),
) -> dict[str, Task]:
    ids = {t.task: f"t{number}" for number, t in enumerate(plan, first_number)}
    return {
        ids[t.task]: _task(state, mission, first_number - 1 + index, t, ids, revision=revision, wait_for=wait_for)
        for index, t in enumerate(plan)
    }


def _index(mission: Mission) -> None:
    mission.graph = TaskGraph({t.task_id: t.dependencies for t in mission.tasks.values()})
    mission.selectors = frozenset(t.selector for t in mission.tasks.values() if t.selector is not None)
    mission.named = frozenset(r for t in mission.tasks.values() for r in t.named)


def _task(
    state: State,
    mission: Mission,
    index: int,
    planned: PlanTask,
    ids: Mapping[str, str],
    *,
    revision: int,
    wait_for: tuple[str, ...],
) -> Task:
    function = planned.instruction_function
    skill = state.catalogue[function.name]
    count = function.robot_count if isinstance(function.robot_count, int) else None
    everyone = skill.fleet_wide and not function.robot_ids and not function.robot_type
    selector = Selector(function.robot_type, count) if function.robot_type or everyone else None
    dependencies = tuple(dict.fromkeys((*(ids[d] for d in function.dependencies), *wait_for)))
    return Task(
        mission_id=mission.mission_id,
        task_id=ids[planned.task],
        order=(mission.urgency, mission.number, index),
        name=planned.task,
        skill=skill,
        named=function.robot_ids,
        selector=selector,
        objects=tuple(dict.fromkeys(function.object_keywords)),
        dependencies=dependencies,
        unmet=set(dependencies),
        robots=() if selector else function.robot_ids,
        revision=revision,
        on_failure=planned.on_failure,
    )
