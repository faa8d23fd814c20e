"""Missions from the instruction to the end: submit, plan, approve, pause, resume, cancel."""

from collections.abc import Callable
from typing import Final

from muster_schemas.mission import MissionStatus, Reason, TaskStatus
from muster_schemas.plan import PlanTask
from muster_schemas.robot import SkillStatusKind
from muster_schemas.rpc import ControlMission, ErrorCode, MissionAction

from . import attempts, failures, outcomes, plans, readiness, requests
from .errors import NotPossibleError
from .events import MissionControlled, MissionSubmitted
from .state import Mission, State
from .turn import Turn

S = MissionStatus

DECISIONS: Final = (MissionAction.RETRY, MissionAction.SKIP, MissionAction.REPLAN)
"""About one task that failed and waits for a person."""
ON_PROPOSALS: Final = (MissionAction.SET_PLAN, MissionAction.APPROVE, MissionAction.REJECT)
"""Also about a running mission, if it has a new plan for its rest that awaits approval."""


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
        plans.set_plan(turn, mission, event.tasks, event.ask_because)


def control(turn: Turn, event: MissionControlled) -> None:
    """Act on a mission; what has been done already is done again without effect.

    Raises:
        NotPossibleError: there is no such mission, or its state does not allow the action.

    """
    control = event.control
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
    if control.plan_revision not in (None, mission.plan_revision):
        raise NotPossibleError(
            ErrorCode.CONFLICT,
            f"the plan of {mission.mission_id} has changed meanwhile: it is at revision {mission.plan_revision}, and"
            f" this is about {control.plan_revision}. Look at it again; nothing was changed",
        )
    if control.action is MissionAction.SET_PLAN:
        if control.plan is None:
            raise NotPossibleError(ErrorCode.INVALID, "set_plan needs a plan")
        _edit(turn, mission, control.plan.tasks, event.ask_because)
    elif control.action in DECISIONS:
        failures.decide(turn, mission, control)
    else:
        _ACTIONS[control.action](turn, mission, control.reasons)


def is_possible(mission: Mission, action: MissionAction) -> bool:
    """Return whether the mission's state allows the action."""
    if mission.cancelling:
        return action is MissionAction.CANCEL
    if action in ON_PROPOSALS and mission.state is S.RUNNING:
        return bool(failures.proposals(mission))
    return mission.state in _ALLOWED[action]


def changes_nothing(state: State, control: ControlMission) -> bool:
    """Return whether the mission is already what the action would make it."""
    mission = state.missions.get(control.mission_id)
    return mission is not None and is_so_already(mission, control)


def is_so_already(mission: Mission, control: ControlMission) -> bool:
    """Return whether this mission is already what the action would make it."""
    if control.action is MissionAction.CANCEL and mission.cancelling:
        return True
    if control.action is MissionAction.SET_PLAN:
        stale = control.plan_revision not in (None, mission.plan_revision)
        return control.plan is not None and mission.plan == control.plan.tasks and not stale
    if control.action is MissionAction.APPROVE and (not mission.approved or failures.proposals(mission)):
        return False
    return mission.state in _DONE[control.action]


def _edit(turn: Turn, mission: Mission, plan: tuple[PlanTask, ...], ask_because: tuple[str, ...]) -> None:
    """Take the planner's plan, a person's instead of it, or a person's instead of a new plan for the rest."""
    edited = failures.proposals(mission) if mission.state is S.RUNNING else ()
    if not edited:
        plans.set_plan(turn, mission, plan, ask_because)
        return
    if len(edited) > 1:
        raise NotPossibleError(ErrorCode.CONFLICT, "several new plans await approval; approve or reject them first")
    edited[0].proposal = plan
    mission.plan_revision += 1
    turn.touch_mission(mission)


def _refuse(turn: Turn, mission: Mission, reasons: tuple[Reason, ...]) -> None:
    mission.reasons = reasons or (Reason(code="rejected", message="A person did not approve the plan."),)
    for task in mission.tasks.values():
        turn.move(task, TaskStatus.CANCELLED, "the plan was not approved")
    turn.move_mission(mission, S.REJECTED)


def _reject(turn: Turn, mission: Mission, reasons: tuple[Reason, ...]) -> None:
    if mission.state is S.RUNNING:
        failures.reject(turn, mission, reasons)
    else:
        _refuse(turn, mission, reasons)


def _approve(turn: Turn, mission: Mission, _reasons: tuple[Reason, ...]) -> None:
    if mission.state is S.RUNNING:
        failures.approve(turn, mission)
        return
    mission.approved = True
    mission.reasons = ()
    turn.move_mission(mission, S.RUNNING)
    plans.start(turn, mission)


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
            task.awaits = task.proposal = None
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
    MissionAction.REJECT: _reject,
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
    MissionAction.RETRY: (S.RUNNING, S.PAUSED),
    MissionAction.SKIP: (S.RUNNING, S.PAUSED),
    MissionAction.REPLAN: (S.RUNNING, S.PAUSED),
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
