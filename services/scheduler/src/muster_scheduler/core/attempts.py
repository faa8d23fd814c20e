"""Attempts at tasks: from the decision to start up to the final word of all of its robots."""

from muster_schemas.mission import TaskStatus
from muster_schemas.robot import SkillStatus, SkillStatusKind, TaskRef

from . import failures, lost, outcomes, readiness, requests
from .effects import Hush, PublishAreas
from .events import TaskDispatched
from .rules import with_rules
from .state import REPEATABLE_VERBS, LooseEnd, Presence, Robot, Run, State, Task
from .turn import Turn

NOT_STARTED = (SkillStatusKind.REFUSED, SkillStatusKind.UNKNOWN)
"""Answers that say that the robot did nothing, so that a new attempt does no harm."""


def dispatch(turn: Turn, task: Task, event: TaskDispatched) -> None:
    """Reserve the robots of a decision and ask them to start."""
    state = turn.state
    readiness.stop_waiting(turn, task)
    task.attempt = event.attempt
    task.targets = event.objects
    task.closing = task.closing_reason = task.error = None
    if event.rules_added or event.rules_removed:
        state.rules = with_rules(state.rules, event.rules_added, event.rules_removed)
        turn.effects.append(PublishAreas(rules=state.rules))
    if task.is_rule:
        task.rules_revision = state.rules.revision
        task.give_up_at = turn.now + state.policy.rules_wait_s
        turn.wake_at(task.give_up_at, task)
    task.runs = {o.robot_id: Run(robot_id=o.robot_id, boot_id=o.boot_id, order=o) for o in event.orders}
    turn.move(task, TaskStatus.DISPATCHED, f"attempt {task.attempt} by {', '.join(task.runs)}")
    for robot_id in task.runs:
        robot = state.robots[robot_id]
        if task.is_rule:
            robot.rule_tasks[task.key] = None
        else:
            robot.holder = task.key
            readiness.robot_changed(turn, robot)
    requests.sync(turn, task)


def is_news(state: State, status: SkillStatus) -> bool:
    """Return whether a status says something new: it is not late, repeated or about nobody's task."""
    task = state.task((status.mission_id, status.task_id))
    robot = state.robots.get(status.robot_id)
    if robot is None or task is None:
        return False
    loose = robot.loose_ends.get(task.key)
    if loose is not None and loose.ref.attempt == status.attempt:
        return status.state.final
    run = task.runs.get(status.robot_id)
    if run is None or not task.active or status.attempt != task.attempt or run.over:
        return False
    if status.boot_id != run.boot_id:
        return status.boot_id > run.boot_id
    if status.seq <= run.seq:
        return False
    told = run.state is status.state is SkillStatusKind.PROGRESS and run.asked is None
    return not told or abs(status.progress - run.progress) >= 0.05


def hear(turn: Turn, status: SkillStatus) -> None:
    """Take in an agent's word, if it is news."""
    if not is_news(turn.state, status):
        return
    robot = turn.state.robots[status.robot_id]
    if status.state.final:
        turn.effects.append(requests.acknowledgement(turn.state, status))
    key = (status.mission_id, status.task_id)
    loose = robot.loose_ends.get(key)
    if loose is not None and loose.ref.attempt == status.attempt:
        _tie_up(turn, robot, loose, status)
        return
    task = turn.state.missions[status.mission_id].tasks[status.task_id]
    run = task.runs[status.robot_id]
    run.boot_id = status.boot_id
    run.seq = status.seq
    forgotten = status.state is SkillStatusKind.UNKNOWN and run.state not in (None, SkillStatusKind.ACCEPTED)
    run.state = SkillStatusKind.INTERRUPTED if forgotten else status.state
    # whatever it was told: who says that it is at work, or was, may have moved
    run.released |= run.state not in (*NOT_STARTED, SkillStatusKind.ACCEPTED, SkillStatusKind.CANCELLED)
    run.progress = max(run.progress, status.progress)
    run.reason = "its agent has lost its memory of this attempt" if forgotten else status.reason
    if run.over:
        robot.rule_tasks.pop(key, None)
        task.story.append(f"{turn.now:.3f} {run.robot_id}: {run.state}{f' ({run.reason})' if run.reason else ''}")
    _follow(turn, task)
    turn.touch(task)
    settle(turn, task)


def _follow(turn: Turn, task: Task) -> None:
    """Let the task's state follow those of its robots."""
    states = {r.state for r in task.runs.values() if not r.over}
    if SkillStatusKind.STARTED in states or SkillStatusKind.PROGRESS in states:
        if task.state is not TaskStatus.RUNNING:
            turn.move(task, TaskStatus.RUNNING)
    elif states == {SkillStatusKind.PAUSED} and task.state is not TaskStatus.PAUSED:
        turn.move(task, TaskStatus.PAUSED)


def obeyed(turn: Turn, robot: Robot, revision: int) -> None:
    """Note that a robot obeys the rules up to `revision`, which ends its part in the tasks that waited for it."""
    robot.rules_revision = revision
    for key in list(robot.rule_tasks):
        task = turn.state.task(key)
        if task is None or task.rules_revision is None or task.rules_revision > revision:
            continue
        del robot.rule_tasks[key]
        run = task.runs[robot.card.robot_id]
        run.state = SkillStatusKind.SUCCEEDED
        turn.touch(task)
        settle(turn, task)


def _refused_rule(turn: Turn, task: Task, run: Run) -> bool:
    """Return whether a robot that refused a request about rules may still obey them: it reads them by itself."""
    robot = turn.state.robots[run.robot_id]
    return (
        task.is_rule
        and run.state is SkillStatusKind.REFUSED
        and task.closing is None
        and robot.rules_revision < (task.rules_revision or 0)
        and task.give_up_at is not None
        and turn.now < task.give_up_at
    )


def settle(turn: Turn, task: Task) -> None:
    """End the attempt if its robots are done; have them all stop if one of them is not going to succeed."""
    if not task.active:
        return
    for run in task.runs.values():
        if not run.over or run.state is SkillStatusKind.SUCCEEDED:
            continue
        if _refused_rule(turn, task, run):
            turn.state.robots[run.robot_id].rule_tasks[task.key] = None
            continue
        if task.closing is None:
            close(turn, task, run.state or SkillStatusKind.FAILED, f"{run.robot_id}: {run.reason or run.state}")
    if task.closing is None and task.is_team:
        _abort_if_lost(turn, task)
    if task.closing is not None:
        _give_up_on_lost(turn, task)
    waits_for_rules = any(_refused_rule(turn, task, r) for r in task.runs.values())
    if waits_for_rules or not all(r.over for r in task.runs.values()):
        requests.sync(turn, task)
        return
    requests.sync(turn, task)
    _end(turn, task)


def close(turn: Turn, task: Task, why: SkillStatusKind, reason: str) -> None:
    """Begin to end an attempt at all of its robots."""
    task.closing = why
    task.closing_reason = reason[:1000]
    task.give_up_at = turn.now + turn.state.policy.cancel_wait_s
    turn.wake_at(task.give_up_at, task)


def _abort_if_lost(turn: Turn, task: Task) -> None:
    """Halt a team of which one is lost: the others must not work beside a machine that nobody hears of."""
    lost = [r for r in task.runs.values() if not r.over and turn.state.robots[r.robot_id].presence is Presence.OFFLINE]
    if lost:
        why = SkillStatusKind.FAILED if any(r.released for r in task.runs.values()) else SkillStatusKind.UNKNOWN
        close(turn, task, why, f"{', '.join(r.robot_id for r in lost)}: lost")


def _give_up_on_lost(turn: Turn, task: Task) -> None:
    for run in task.runs.values():
        robot = turn.state.robots[run.robot_id]
        timed_out = task.give_up_at is not None and turn.now >= task.give_up_at
        if run.over or (robot.presence is not Presence.OFFLINE and not timed_out):
            continue
        why = "does not answer" if robot.presence is Presence.ONLINE else "is lost"
        run.state = SkillStatusKind.UNKNOWN
        run.lost = True
        run.reason = f"it {why}: whether it stopped is not known"
        run.asked = None
        loosen(turn, robot, task.ref, task.skill.name)


def loosen(turn: Turn, robot: Robot, ref: TaskRef, skill: str) -> None:
    """Close an attempt here that may go on at the robot: nobody gets it before it has said that it stopped."""
    robot.loose_ends[ref.mission_id, ref.task_id] = LooseEnd(ref=ref, skill=skill)
    requests.chase(turn, robot)


def _tie_up(turn: Turn, robot: Robot, loose: LooseEnd, status: SkillStatus) -> None:
    key = (loose.ref.mission_id, loose.ref.task_id)
    del robot.loose_ends[key]
    turn.effects.append(Hush(robot_id=robot.card.robot_id, ref=loose.ref))
    mission = turn.state.missions[loose.ref.mission_id]
    task = mission.tasks[loose.ref.task_id]
    run = task.runs.get(robot.card.robot_id)
    if run is not None and task.active and task.attempt == loose.ref.attempt:
        # the others of its team are still being stopped, so its word comes in time for the outcome
        run.state, run.reason, run.lost = status.state, status.reason, False
    if robot.card.robot_id in mission.stopping:
        mission.stopping[robot.card.robot_id] = outcomes.LAST_WORDS[status.state]
    readiness.robot_changed(turn, robot)


def _end(turn: Turn, task: Task) -> None:
    """All robots have said their last: succeeded, to be tried again, failed or cancelled."""
    state = turn.state
    mission = state.missions[task.mission_id]
    task.give_up_at = None
    for robot_id, run in task.runs.items():
        robot = state.robots[robot_id]
        robot.rule_tasks.pop(task.key, None)
        if mission.cancelling and run.state is not None:
            mission.stopping[robot_id] = outcomes.last_word(run)
        if robot.holder == task.key:
            robot.holder = None
            readiness.robot_changed(turn, robot)
    task.error = None if all(r.state is SkillStatusKind.SUCCEEDED for r in task.runs.values()) else task.closing_reason
    if task.error is None:
        turn.move(task, TaskStatus.SUCCEEDED)
        outcomes.task_succeeded(turn, mission, task)
    elif mission.cancelling:
        task.error = _unknown_outcomes(task)
        turn.move(task, TaskStatus.CANCELLED)
    elif _may_repeat(turn, task):
        turn.move(task, TaskStatus.READY, task.error)
        pause_s = failures.pause_s(failures.policy_of(state, task), task.failures) if task.failures else None
        task.hold_until = turn.now + (state.policy.retry_after_s if pause_s is None else pause_s)
        turn.wake_at(task.hold_until, task)
        readiness.refresh(turn, task)
    else:
        failures.come_to_nothing(turn, task, task.error)
    outcomes.maybe_end(turn, mission)


def _may_repeat(turn: Turn, task: Task) -> bool:
    """Count what did not work, and say whether the policy allows another attempt."""
    policy = turn.state.policy
    runs = task.runs.values()
    if any(r.lost and r.released for r in runs):
        return False
    repeatable = task.skill.verb in REPEATABLE_VERBS
    unmoved = all(r.state in NOT_STARTED or not r.released for r in runs)
    if task.closing in NOT_STARTED and (repeatable or unmoved):
        task.refusals += 1
        return task.refusals < policy.refusals
    task.failures += 1
    return task.failures <= (failures.policy_of(turn.state, task).retries or 0)


def _unknown_outcomes(task: Task) -> str | None:
    return "; ".join(f"{r.robot_id}: {r.reason}" for r in task.runs.values() if r.lost)[:1000] or None


def blocked(turn: Turn, task: Task, why: str) -> None:
    """Wait a while for room, and no longer than the policy allows."""
    policy = turn.state.policy
    if task.give_up_at is None:
        task.give_up_at = turn.now + policy.room_wait_s
        turn.wake_at(task.give_up_at, task)
    task.no_room = why
    task.hold_until = turn.now + policy.retry_after_s
    turn.wake_at(task.hold_until, task)
    readiness.refresh(turn, task)


def deferred(turn: Turn, task: Task, until: float, why: str) -> None:
    """Leave its robots to others for now; it stays in their queues, and is looked at again at `until` at the latest."""
    task.kept_until, task.kept_for = until, why
    turn.wake_at(until, task)
    readiness.set_waiting(turn, task)


def time_passed(turn: Turn, task: Task) -> None:
    """Look at a task again at a time that it had set."""
    late = task.give_up_at is not None and turn.now >= task.give_up_at
    lost_robot = lost.lost_too_long(turn.state, task, turn.now)
    if task.active:
        if lost_robot is not None and task.closing is None:
            close(turn, task, SkillStatusKind.FAILED, f"{lost_robot} was lost too long: what it did is not known")
        if late and task.closing is None:
            silent = ", ".join(r.robot_id for r in task.runs.values() if r.state is not SkillStatusKind.SUCCEEDED)
            close(turn, task, SkillStatusKind.FAILED, f"{silent}: the area rules are not obeyed")
        settle(turn, task)
    elif late and (task.missing or task.no_room):
        what = f"{', '.join(sorted(task.missing))} did not come back" if task.missing else task.no_room
        failures.come_to_nothing(turn, task, f"gave up after waiting: {what}")
    elif lost_robot is not None and task.state is TaskStatus.READY and task.awaits is None:
        failures.come_to_nothing(turn, task, f"{lost_robot} was lost too long")
    elif task.hold_until is not None and turn.now >= task.hold_until:
        task.hold_until = None
        readiness.refresh(turn, task)
    elif task.kept_until is not None and turn.now >= task.kept_until:
        task.kept_until = task.kept_for = None
        readiness.refresh(turn, task)
