"""What each robot is asked at any time. It follows from the state alone, so after any change `sync` puts it right."""

from muster_schemas.mission import MissionStatus
from muster_schemas.robot import RequestAction, SkillRequest, SkillStatus, SkillStatusKind, StatusAck

from . import failures, readiness
from .effects import Acknowledge, Hush, Send
from .events import Order
from .state import Robot, Run, State, Task
from .turn import Turn


def sync(turn: Turn, task: Task) -> None:
    """Send each robot of the attempt what it should be told now, and nothing else."""
    for run in task.runs.values():
        wanted = _wanted(turn.state, task, run)
        if wanted == run.asked:
            continue
        run.asked = wanted
        run.released |= wanted is not None and wanted[0] is RequestAction.START
        if wanted is None:
            turn.effects.append(Hush(robot_id=run.robot_id, ref=task.ref))
        else:
            turn.effects.append(Send(request=_request(turn.state, task, run.order, *wanted)))
    readiness.set_waiting(turn, task)


def _wanted(state: State, task: Task, run: Run) -> tuple[RequestAction, str] | None:
    if run.over:
        return None
    boot_id = state.robots[run.robot_id].card.boot_id
    stopped = state.robots[run.robot_id].stopped and not task.is_rule
    halted = stopped or state.missions[task.mission_id].state is MissionStatus.PAUSED
    run_paused = run.state is SkillStatusKind.PAUSED
    action: RequestAction | None = None
    if task.closing is not None:
        action = RequestAction.CANCEL
    elif run.boot_id != boot_id or (halted and run.state is None):
        # a later life of the agent, or a start that may never have arrived and must not happen now: what is known?
        action = RequestAction.QUERY
    elif run.state is None:
        action = RequestAction.PREPARE if task.is_team else RequestAction.START
    elif run.state is SkillStatusKind.ACCEPTED and task.is_team:
        # the common start: none moves before all have accepted
        action = RequestAction.START if task.assembled and not halted else None
    elif halted and not run_paused and not task.is_rule:
        action = RequestAction.PAUSE
    elif run_paused and not halted:
        action = RequestAction.RESUME
    return (action, boot_id) if action else None


def _request(state: State, task: Task, order: Order, action: RequestAction, boot_id: str) -> SkillRequest:
    return SkillRequest(
        action=action,
        mission_id=task.mission_id,
        task_id=task.task_id,
        attempt=task.attempt,
        epoch=state.epoch,
        robot_id=order.robot_id,
        boot_id=boot_id,
        skill=task.skill.name,
        issued_at=state.now,
        deadline=state.now,
        timeout_s=failures.policy_of(state, task).timeout_s or task.skill.timeout_s,
        objects=task.targets,
        goals=order.goals,
        partner=order.partner,
        rules_revision=task.rules_revision if task.is_rule else None,
    )


def acknowledgement(state: State, status: SkillStatus) -> Acknowledge:
    """Return the receipt for a final status."""
    ack = StatusAck(
        mission_id=status.mission_id,
        task_id=status.task_id,
        attempt=status.attempt,
        robot_id=status.robot_id,
        boot_id=status.boot_id,
        seq=status.seq,
        epoch=state.epoch,
    )
    return Acknowledge(skill=status.skill, ack=ack)


def chase(turn: Turn, robot: Robot) -> None:
    """Tell a robot's current life to stop what was closed without its word."""
    for loose in robot.loose_ends.values():
        if loose.asked == robot.card.boot_id:
            continue
        loose.asked = robot.card.boot_id
        task = turn.state.missions[loose.ref.mission_id].tasks[loose.ref.task_id]
        order = Order(robot_id=robot.card.robot_id, boot_id=robot.card.boot_id)
        request = _request(turn.state, task, order, RequestAction.CANCEL, robot.card.boot_id)
        turn.effects.append(Send(request=request.model_copy(update={"attempt": loose.ref.attempt})))
