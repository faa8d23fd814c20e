"""One event being handled: its time, the effects so far, and what has to be published at its end."""

import heapq

from muster_schemas.mission import MissionStatus, TaskStatus

from .effects import Effect, PublishMission, PublishTask
from .queue import TaskKey
from .state import Mission, State, Task
from .transitions import MISSION_MOVES, TASK_MOVES, InvalidTransition


class Turn:
    """Changes to the state during one event."""

    def __init__(self, state: State, at: float) -> None:
        state.now = max(state.now, at)
        self.state = state
        self.now = state.now
        self.effects: list[Effect] = []
        self._tasks: dict[TaskKey, Task] = {}
        self._missions: dict[str, Mission] = {}

    def touch(self, task: Task) -> None:
        """Publish the task when the event is done with."""
        self._tasks[task.key] = task

    def touch_mission(self, mission: Mission) -> None:
        """Publish the mission when the event is done with."""
        self._missions[mission.mission_id] = mission

    def move(self, task: Task, to: TaskStatus, why: str = "") -> None:
        """Take a task to another state.

        Raises:
            InvalidTransition: the table has no such move.

        """
        if (task.state, to) not in TASK_MOVES:
            raise InvalidTransition(f"task {task.mission_id}/{task.task_id}", task.state, to, task.story)
        task.story.append(f"{self.now:.3f} {task.state} -> {to}: {why or TASK_MOVES[task.state, to]}")
        mission = self.state.missions[task.mission_id]
        was_active = task.active
        task.state = to
        if task.active != was_active:
            (mission.active.add if task.active else mission.active.discard)(task.task_id)
        if to is TaskStatus.READY and task.ready_at is None:
            task.ready_at = self.now
        if to is TaskStatus.RUNNING and task.started_at is None:
            task.started_at = self.now
        if to.ended:
            task.ended_at = self.now
            task.waiting_for = ()
            mission.open_tasks -= 1
            mission.unsuccessful += to is not TaskStatus.SUCCEEDED and not task.excused
        self.touch(task)

    def move_mission(self, mission: Mission, to: MissionStatus) -> None:
        """Take a mission to another state.

        Raises:
            InvalidTransition: the table has no such move.

        """
        if (mission.state, to) not in MISSION_MOVES:
            raise InvalidTransition(f"mission {mission.mission_id}", mission.state, to)
        del self.state.by_state[mission.state][mission.mission_id]
        self.state.by_state[to][mission.mission_id] = None
        mission.state = to
        if to is MissionStatus.RUNNING and mission.started_at is None:
            mission.started_at = self.now
        if to.ended:
            mission.ended_at = self.now
        self.touch_mission(mission)

    def wake_at(self, due: float, task: Task) -> None:
        """Look at the task again at `due`."""
        heapq.heappush(self.state.timers, (due, task.key))

    def end(self) -> list[Effect]:
        """Return all effects, with what has to be published last."""
        for task in self._tasks.values():
            task.revision += 1
            self.effects.append(PublishTask(task))
        for mission in self._missions.values():
            mission.revision += 1
            self.effects.append(PublishMission(mission))
        return self.effects
