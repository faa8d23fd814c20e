"""What the end of a task means for the tasks after it and for its mission."""

from typing import Final

from muster_schemas.mission import MissionStatus, Reason, TaskStatus
from muster_schemas.robot import SkillStatusKind

from . import lost, readiness
from .state import Mission, Run, Task
from .turn import Turn

NO_WORD = "no answer yet"
LAST_WORDS: Final = {
    SkillStatusKind.SUCCEEDED: "had finished",
    SkillStatusKind.FAILED: "had failed",
    SkillStatusKind.CANCELLED: "stopped",
    SkillStatusKind.INTERRUPTED: "stopped when its agent restarted",
    SkillStatusKind.REFUSED: "had not started",
    SkillStatusKind.UNKNOWN: "had not started",
}
"""What a person who cancelled is told, by the robot's final status."""


def last_word(run: Run) -> str:
    """Return what is known of a robot after a cancel."""
    if run.lost:
        return f"{run.reason}"
    return NO_WORD if run.state is None else LAST_WORDS.get(run.state, NO_WORD)


def make_ready(turn: Turn, mission: Mission, task: Task) -> None:
    """All dependencies of a task are done."""
    turn.move(task, TaskStatus.READY)
    readiness.bind(turn, mission, task)
    readiness.refresh(turn, task)
    lost.watch(turn, task)


def task_succeeded(turn: Turn, mission: Mission, task: Task) -> None:
    """Let the tasks go that waited for this one."""
    for after_id in mission.graph.successors(task.task_id):
        after = mission.tasks[after_id]
        after.unmet.discard(task.task_id)
        if after.state is not TaskStatus.WAITING:
            continue
        if after.unmet:
            readiness.set_waiting(turn, after)
        else:
            make_ready(turn, mission, after)


def task_failed(turn: Turn, mission: Mission, task: Task) -> None:
    """Skip all that would have come after it; other branches go on."""
    turn.state.agenda.missions[mission.mission_id] = None
    for after_id in mission.graph.steps_to(task.task_id):
        after = mission.tasks[after_id]
        if after.state is TaskStatus.WAITING:
            after.error = f"{task.name} did not succeed"
            turn.move(after, TaskStatus.SKIPPED, f"{task.task_id} failed")


def maybe_end(turn: Turn, mission: Mission) -> None:
    """End the mission if none of its tasks is open."""
    if mission.open_tasks or mission.state not in (MissionStatus.RUNNING, MissionStatus.PAUSED):
        return
    if mission.cancelling:
        end_cancelled(turn, mission)
    elif mission.unsuccessful:
        mission.reasons = tuple(
            Reason(code="task_failed", task=t.name, message=f"{t.name}: {t.error or t.state}"[:1000])
            for t in mission.tasks.values()
            if t.state is TaskStatus.FAILED
        )
        turn.move_mission(mission, MissionStatus.FAILED)
    else:
        turn.move_mission(mission, MissionStatus.SUCCEEDED)


def end_cancelled(turn: Turn, mission: Mission) -> None:
    """Nothing of it is under way any more, as far as anyone knows; say where that is not known."""
    mission.reasons = tuple(
        Reason(code="outcome_unknown", task=t.name, message=f"{t.name}: {r.robot_id}: {r.reason}"[:1000])
        for t in mission.tasks.values()
        for r in t.runs.values()
        if r.lost
    )
    turn.move_mission(mission, MissionStatus.CANCELLED)
