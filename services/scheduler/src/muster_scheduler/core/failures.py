"""What is done about a task that failed: again after a pause, by other robots, by a new plan, or as a person says.

A policy is looked up from the narrow to the wide: the task's own, the skill's, the site's, what is built in. Its
measures are taken one after the other; one that cannot be taken is passed over, and at their end the task has failed.
"""

from collections.abc import Callable
from typing import Final

from muster_schemas.mission import Reason, TaskStatus
from muster_schemas.policies import FailurePolicy, Measure
from muster_schemas.rpc import ControlMission, ErrorCode, MissionAction, ReplanMission

from . import outcomes, plans, readiness
from .effects import AskPlanner
from .errors import NotPossibleError
from .events import MissionReplanned
from .state import REPEATABLE_VERBS, Awaits, Mission, Presence, State, Task
from .turn import Turn

LONGEST_PAUSE_S: Final = 60.0


def policy_of(state: State, task: Task) -> FailurePolicy:
    """Return what holds for a task, with nothing left out but the timeout."""
    site = state.policy
    built_in = FailurePolicy(
        retries=site.retries if task.skill.verb in REPEATABLE_VERBS else 0, retry_after_s=site.retry_after_s, then=()
    )
    # a number of retries for the whole site does not mean that soil is dug twice
    wide = site.failures.default
    if task.skill.verb not in REPEATABLE_VERBS:
        wide = wide.model_copy(update={"retries": None})
    for_skill = FailurePolicy()
    for name, policy in site.failures.skills.items():
        if state.catalogue.canonical(name) == task.skill.name:
            for_skill = policy
    return (task.on_failure or FailurePolicy()).over(for_skill.over(wide.over(built_in)))


def pause_s(policy: FailurePolicy, failures: int) -> float:
    """Return the pause before the next attempt: doubled with each failure."""
    first = policy.retry_after_s or 0.0
    return min(first * 2 ** min(max(failures - 1, 0), 16), max(first, LONGEST_PAUSE_S))


def come_to_nothing(turn: Turn, task: Task, reason: str) -> None:
    """Repeating does not help, or is not allowed: take the next measure, or let the task fail."""
    mission = turn.state.missions[task.mission_id]
    task.error = reason[:1000]
    measures = policy_of(turn.state, task).then or ()
    while not mission.cancelling and task.measures < len(measures):
        measure = measures[task.measures]
        task.measures += 1
        if _MEASURES[measure](turn, mission, task):
            readiness.refresh(turn, task)
            return
    readiness.stop_waiting(turn, task)
    turn.move(task, TaskStatus.FAILED, task.error)
    outcomes.task_failed(turn, mission, task)
    outcomes.maybe_end(turn, mission)


def _make_ready(turn: Turn, task: Task) -> None:
    readiness.stop_waiting(turn, task)
    if task.state is not TaskStatus.READY:
        turn.move(task, TaskStatus.READY, task.error or "")
    task.failures = task.refusals = 0


def _reassign(turn: Turn, mission: Mission, task: Task) -> bool:
    """Let other robots be chosen, if the plan leaves the choice open and nothing hangs on the robots of before."""
    selector = task.selector
    began = any(r.state is not None and not r.never_moved for r in task.runs.values())
    if selector is None or selector.count is None or (began and task.skill.verb not in REPEATABLE_VERBS):
        return False
    same = [t for t in mission.tasks.values() if t.selector == selector and t is not task]
    if any(t.active or t.state is TaskStatus.SUCCEEDED for t in same):
        return False
    barred = mission.barred.get(selector.name, frozenset()) | _to_blame(turn.state, task)
    needed = {t.skill.name for t in (*same, task)}
    for robot_type in selector.types:
        able = [
            r
            for r in turn.state.robots.values()
            if r.card.type == robot_type and r.presence is Presence.ONLINE and not r.stopped
            if r.card.robot_id not in barred and needed <= set(r.card.skills)
        ]
        if len(able) < selector.count:
            return False
    mission.barred[selector.name] = barred
    turn.state.agenda.missions[mission.mission_id] = None
    mission.bound.pop(selector.name, None)
    _make_ready(turn, task)
    for other in (task, *same):
        if not other.state.ended:
            readiness.leave_queues(turn, other)
            other.robots = ()
            turn.touch(other)
            readiness.refresh(turn, other)
    return True


def _to_blame(state: State, task: Task) -> frozenset[str]:
    """Return the robots that failed or are gone; all of the task's if none stands out."""
    blamed = {
        r for r in task.robots
        if state.robots[r].presence is not Presence.ONLINE or (r in task.runs and task.runs[r].failed)
    }  # fmt: skip
    return frozenset(blamed or task.robots)


def _ask_planner(turn: Turn, mission: Mission, task: Task) -> bool:
    if mission.replans >= turn.state.policy.failures.replans:
        return False
    mission.replans += 1
    _make_ready(turn, task)
    task.awaits = Awaits.PLANNER
    task.replan_number = mission.replans
    turn.effects.append(replan_request(mission, task))
    return True


def _ask_person(turn: Turn, _mission: Mission, task: Task) -> bool:
    _make_ready(turn, task)
    task.awaits = Awaits.DECISION
    return True


_MEASURES: Final[dict[Measure, Callable[[Turn, Mission, Task], bool]]] = {
    Measure.REASSIGN: _reassign,
    Measure.REPLAN: _ask_planner,
    Measure.ASK: _ask_person,
}


def replan_request(mission: Mission, task: Task) -> AskPlanner:
    """Return what the planner is told: what was done, what failed and why, what was to come."""
    going_on = {t.name for t in mission.tasks.values() if not t.state.ended and t is not task}
    rest = plans.rest_of(mission, task)
    going_on -= {p.task for p in rest}
    (failed,) = [p for p in mission.plan or () if p.task == task.name]
    return AskPlanner(
        request=ReplanMission(
            mission_id=mission.mission_id,
            task_id=task.task_id,
            number=task.replan_number,
            text=mission.text,
            priority=mission.priority,
            done=plans.planned_in(mission, TaskStatus.SUCCEEDED),
            going_on=tuple(p for p in mission.plan or () if p.task in going_on),
            failed=failed,
            error=task.error or "",
            rest=rest,
        )
    )


def replanned(turn: Turn, event: MissionReplanned) -> None:
    """Take in the planner's answer: go on by the new plan, show it to a person, or take the next measure."""
    task = turn.state.task((event.mission_id, event.task_id))
    if task is None or task.awaits is not Awaits.PLANNER or task.replan_number != event.number:
        return  # cancelled meanwhile, or an answer to an older question
    mission = turn.state.missions[event.mission_id]
    task.awaits = None
    if event.tasks is None:
        why = " ".join(r.message for r in event.reasons) or "no reason given"
        come_to_nothing(turn, task, f"{task.error}; no new plan: {why}")
    elif mission.approval == "ask" or event.ask_because:
        task.awaits = Awaits.APPROVAL
        task.proposal = event.tasks
        mission.reasons = plans.reasons_to_ask(event.ask_because)
        mission.plan_revision += 1
        turn.touch_mission(mission)
        turn.touch(task)
        readiness.refresh(turn, task)
    else:
        plans.replace_rest(turn, mission, task, event.tasks)


def proposals(mission: Mission) -> list[Task]:
    """Return the failed tasks whose new plans await approval."""
    return [t for t in mission.tasks.values() if t.awaits is Awaits.APPROVAL]


def approve(turn: Turn, mission: Mission) -> None:
    """Go on by the new plans that a person has seen."""
    mission.reasons = ()
    for task in proposals(mission):
        if task.proposal is not None:
            plans.replace_rest(turn, mission, task, task.proposal)


def reject(turn: Turn, mission: Mission, reasons: tuple[Reason, ...]) -> None:
    """Drop the new plans: the next measure is taken."""
    mission.reasons = ()
    why = " ".join(r.message for r in reasons) or "a person turned the new plan down"
    for task in proposals(mission):
        task.awaits = task.proposal = None
        come_to_nothing(turn, task, f"{task.error}; {why}")


def decide(turn: Turn, mission: Mission, control: ControlMission) -> None:
    """Do with a task what a person says who was asked about it.

    Raises:
        NotPossibleError: there is no such task, or it waits for no decision.

    """
    task = mission.tasks.get(control.task_id or "")
    if task is None:
        raise NotPossibleError(
            ErrorCode.NOT_FOUND, f"{mission.mission_id} has no task {control.task_id or '(none given)'}"
        )
    if task.awaits is not Awaits.DECISION:
        waits = ", ".join(task.waiting_for) or "nothing"
        raise NotPossibleError(
            ErrorCode.CONFLICT, f"task {task.task_id} is {task.state} and waits for {waits}, not for a decision"[:2000]
        )
    if control.action is MissionAction.REPLAN and mission.replans >= turn.state.policy.failures.replans:
        raise NotPossibleError(
            ErrorCode.CONFLICT, f"{mission.mission_id} has had {mission.replans} new plans, as many as the site allows"
        )
    task.awaits = None
    task.measures -= 1  # should this not help either, the person is asked again
    if control.action is MissionAction.SKIP:
        readiness.stop_waiting(turn, task)
        task.excused = task.skipped_by_person = True
        turn.move(task, TaskStatus.SKIPPED, "a person goes on without it")
        outcomes.task_succeeded(turn, mission, task)
        outcomes.maybe_end(turn, mission)
        return
    if control.action is MissionAction.REPLAN:
        _ask_planner(turn, mission, task)
    readiness.refresh(turn, task)
