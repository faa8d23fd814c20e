"""Missions from the instruction to the end: submit, plan, approve, pause, resume, cancel."""

from collections.abc import Callable
from typing import Final

from muster_schemas.mission import MissionStatus, Reason, TaskStatus
from muster_schemas.plan import PlanTask
from muster_schemas.robot import SkillStatusKind
from muster_schemas.rpc import ControlMission, ErrorCode, MissionAction

from . import attempts, outcomes, readiness, requests
from .effects import RetractTask
from .errors import NotPossibleError
from .events import MissionSubmitted
from .graph import TaskGraph
from .state import Mission, Selector, State, Task
from .turn import Turn

S = MissionStatus


def submit(turn: Turn, event: MissionSubmitted) -> None:
    """Make a mission."""
    state = turn.state
    if event.mission_id in state.missions:
        raise NotPossibleError(ErrorCode.CONFLICT, f"there is a mission {event.mission_id} already")
    if event.idempotency_key is not None:
        if event.idempotency_key in state.by_idempotency_key:
            raise NotPossibleError(ErrorCode.CONFLICT, "this idempotency key has made a mission already")
        state.by_idempotency_key[event.idempotency_key] = event.mission_id
    mission = Mission(
        mission_id=event.mission_id,
        number=state.submitted,
        text=event.text,
        priority=event.priority,
        approval=event.approval,
        created_at=turn.now,
        idempotency_key=event.idempotency_key,
    )
    state.submitted += 1
    state.missions[mission.mission_id] = mission
    state.by_state[mission.state][mission.mission_id] = None
    turn.touch_mission(mission)
    if event.tasks is not None:
        _set_plan(turn, mission, event.tasks)


def control(turn: Turn, control: ControlMission) -> None:
    """Act on a mission; what has been done already is done again without effect.

    Raises:
        NotPossibleError: there is no such mission, or its state does not allow the action.

    """
    mission = turn.state.missions.get(control.mission_id)
    if mission is None:
        raise NotPossibleError(ErrorCode.NOT_FOUND, f"there is no mission {control.mission_id}")
    if changes_nothing(turn.state, control):
        return
    if not is_possible(mission, control.action):
        stands = "being cancelled" if mission.cancelling else mission.state
        raise NotPossibleError(
            ErrorCode.CONFLICT, f"mission {mission.mission_id} is {stands}: {control.action} is not possible now"
        )
    if control.action is MissionAction.SET_PLAN:
        if control.plan is None:
            raise NotPossibleError(ErrorCode.INVALID, "set_plan needs a plan")
        _set_plan(turn, mission, control.plan.tasks)
    else:
        _ACTIONS[control.action](turn, mission, control.reasons)


def is_possible(mission: Mission, action: MissionAction) -> bool:
    """Return whether the mission's state allows the action."""
    return mission.state in _ALLOWED[action] and not (mission.cancelling and action is not MissionAction.CANCEL)


def changes_nothing(state: State, control: ControlMission) -> bool:
    """Return whether the mission is already what the action would make it."""
    mission = state.missions.get(control.mission_id)
    return mission is not None and is_so_already(mission, control)


def is_so_already(mission: Mission, control: ControlMission) -> bool:
    """Return whether this mission is already what the action would make it."""
    if control.action is MissionAction.CANCEL and mission.cancelling:
        return True
    if control.action is MissionAction.SET_PLAN:
        return control.plan is not None and mission.plan == control.plan.tasks
    if control.action is MissionAction.APPROVE and mission.approval == "auto":
        return False
    return mission.state in _DONE[control.action]


def _set_plan(turn: Turn, mission: Mission, plan: tuple[PlanTask, ...]) -> None:
    for task_id in mission.tasks:
        turn.effects.append(RetractTask(mission_id=mission.mission_id, task_id=task_id))
    first_revision = max((t.revision for t in mission.tasks.values()), default=0)
    mission.plan = plan
    ids = {t.task: f"t{number}" for number, t in enumerate(plan, 1)}
    mission.tasks = {
        ids[t.task]: _task(turn.state, mission, index, t, ids, first_revision) for index, t in enumerate(plan)
    }
    mission.graph = TaskGraph({t.task_id: t.dependencies for t in mission.tasks.values()})
    mission.selectors = frozenset(t.selector for t in mission.tasks.values() if t.selector is not None)
    mission.named = frozenset(r for t in mission.tasks.values() for r in t.named)
    mission.open_tasks = len(mission.tasks)
    to = S.RUNNING if mission.approval == "auto" else S.AWAITING_APPROVAL
    if mission.state is not to:
        turn.move_mission(mission, to)
    turn.touch_mission(mission)
    for task in mission.tasks.values():
        turn.touch(task)
    _begin(turn, mission)


def _begin(turn: Turn, mission: Mission) -> None:
    if mission.state is S.RUNNING:
        mission.urgency = turn.now + (9 - mission.priority) * turn.state.policy.ageing_s
        turn.state.agenda.missions[mission.mission_id] = None
        for task in mission.tasks.values():
            task.order = (mission.urgency, *task.order[1:])
    for task in mission.tasks.values():
        if mission.state is S.RUNNING and not task.unmet:
            outcomes.make_ready(turn, mission, task)
        else:
            readiness.set_waiting(turn, task)


def _task(
    state: State, mission: Mission, index: int, planned: PlanTask, ids: dict[str, str], revision: int
) -> Task:  # fmt: skip
    function = planned.instruction_function
    skill = state.catalogue[function.name]
    count = function.robot_count if isinstance(function.robot_count, int) else None
    everyone = skill.fleet_wide and not function.robot_ids and not function.robot_type
    selector = Selector(function.robot_type, count) if function.robot_type or everyone else None
    dependencies = tuple(dict.fromkeys(ids[d] for d in function.dependencies))
    return Task(
        mission_id=mission.mission_id,
        task_id=ids[planned.task],
        order=(0.0, mission.number, index),
        name=planned.task,
        skill=skill,
        named=function.robot_ids,
        selector=selector,
        objects=tuple(dict.fromkeys(function.object_keywords)),
        dependencies=dependencies,
        unmet=set(dependencies),
        robots=() if selector else function.robot_ids,
        revision=revision,
    )


def _refuse(turn: Turn, mission: Mission, reasons: tuple[Reason, ...]) -> None:
    mission.reasons = reasons or (Reason(code="rejected", message="A person did not approve the plan."),)
    for task in mission.tasks.values():
        turn.move(task, TaskStatus.CANCELLED, "the plan was not approved")
    turn.move_mission(mission, S.REJECTED)


def _approve(turn: Turn, mission: Mission, _reasons: tuple[Reason, ...]) -> None:
    turn.move_mission(mission, S.RUNNING)
    _begin(turn, mission)


def _pause(turn: Turn, mission: Mission, _reasons: tuple[Reason, ...]) -> None:
    turn.move_mission(mission, S.PAUSED)
    _after_pause_or_resume(turn, mission)


def _resume(turn: Turn, mission: Mission, _reasons: tuple[Reason, ...]) -> None:
    turn.move_mission(mission, S.RUNNING)
    _after_pause_or_resume(turn, mission)


def _after_pause_or_resume(turn: Turn, mission: Mission) -> None:
    turn.state.agenda.missions[mission.mission_id] = None
    for task in mission.tasks.values():
        if task.active:
            requests.sync(turn, task)
        elif task.state is TaskStatus.READY:
            readiness.refresh(turn, task)


def _cancel(turn: Turn, mission: Mission, _reasons: tuple[Reason, ...]) -> None:
    mission.cancelling = True
    for task in mission.tasks.values():
        if task.state in (TaskStatus.WAITING, TaskStatus.READY):
            readiness.stop_waiting(turn, task)
            turn.move(task, TaskStatus.CANCELLED)
    for task_id in sorted(mission.active):
        task = mission.tasks[task_id]
        mission.stopping |= {r.robot_id: outcomes.last_word(r) for r in task.runs.values()}
        attempts.close(turn, task, SkillStatusKind.CANCELLED, "cancelled with its mission")
        attempts.settle(turn, task)
    if not mission.state.ended and not mission.active:
        outcomes.end_cancelled(turn, mission)


_ACTIONS: Final[dict[MissionAction, Callable[[Turn, Mission, tuple[Reason, ...]], None]]] = {
    MissionAction.REFUSE: _refuse,
    MissionAction.APPROVE: _approve,
    MissionAction.REJECT: _refuse,
    MissionAction.CANCEL: _cancel,
    MissionAction.PAUSE: _pause,
    MissionAction.RESUME: _resume,
}
_ALLOWED: Final = {
    MissionAction.SET_PLAN: (S.PLANNING, S.AWAITING_APPROVAL),
    MissionAction.REFUSE: (S.PLANNING,),
    MissionAction.APPROVE: (S.AWAITING_APPROVAL,),
    MissionAction.REJECT: (S.AWAITING_APPROVAL,),
    MissionAction.CANCEL: (S.PLANNING, S.AWAITING_APPROVAL, S.RUNNING, S.PAUSED),
    MissionAction.PAUSE: (S.RUNNING,),
    MissionAction.RESUME: (S.PAUSED,),
    MissionAction.RETRY: (),
    MissionAction.SKIP: (),
    MissionAction.REPLAN: (),
}
_DONE: Final = {
    MissionAction.REFUSE: (S.REJECTED,),
    MissionAction.APPROVE: (S.RUNNING,),
    MissionAction.REJECT: (S.REJECTED,),
    MissionAction.CANCEL: (S.CANCELLED,),
    MissionAction.PAUSE: (S.PAUSED,),
    MissionAction.RESUME: (S.RUNNING,),
    MissionAction.RETRY: (),
    MissionAction.SKIP: (),
    MissionAction.REPLAN: (),
}
