"""Robots that have been lost for longer than the site waits for them, if it says how long that is."""

from muster_schemas.mission import MissionStatus

from .state import State, Task
from .turn import Turn


def lost_too_long(state: State, task: Task, now: float) -> str | None:
    """Return which of a task's robots has been lost for too long, or None."""
    wait_s = state.policy.failures.lost_after_s
    if wait_s is None or state.missions[task.mission_id].state is not MissionStatus.RUNNING:
        return None
    for robot_id in task.robots:
        robot = state.robots.get(robot_id)
        run = task.runs.get(robot_id) if task.active else None
        if robot is None or robot.lost_at is None or (run is not None and run.over):
            continue
        if now >= robot.lost_at + wait_s:
            return robot_id
    return None


def watch(turn: Turn, task: Task) -> None:
    """Look at a task again when one of its robots, lost now, will have been lost for too long."""
    wait_s = turn.state.policy.failures.lost_after_s
    for robot_id in task.robots if wait_s is not None else ():
        robot = turn.state.robots.get(robot_id)
        if robot is not None and robot.lost_at is not None:
            turn.wake_at(max(robot.lost_at + (wait_s or 0.0), turn.now), task)
