"""What the core wants done once the event that caused it is in the journal. Doing one twice equals doing it once."""

from dataclasses import dataclass
from typing import Literal

from muster_schemas.base import Message
from muster_schemas.ids import Id
from muster_schemas.mission import MissionState, TaskState
from muster_schemas.robot import SkillRequest, StatusAck, TaskRef
from muster_schemas.rpc import ReplanMission
from muster_schemas.stops import StopRequest
from muster_schemas.world import AreaRules

from .state import Mission, Task
from .views import mission_state, task_state


class Send(Message):
    """Send this request now and again until another for the same robot and attempt, or `Hush`, takes its place.

    The sender fills in `issued_at` and `deadline` each time.
    """

    kind: Literal["send"] = "send"
    request: SkillRequest


class Hush(Message):
    """The robot has answered: stop sending."""

    kind: Literal["hush"] = "hush"
    robot_id: Id
    ref: TaskRef


class SendStop(Message):
    """Send this order to stop or go on now and again until another one, or `HushStop`, takes its place."""

    kind: Literal["send_stop"] = "send_stop"
    request: StopRequest


class HushStop(Message):
    """The robot has obeyed: stop sending."""

    kind: Literal["hush_stop"] = "hush_stop"
    robot_id: Id


class Acknowledge(Message):
    """Tell the agent that its word is in the journal."""

    kind: Literal["acknowledge"] = "acknowledge"
    skill: Id
    ack: StatusAck


class AskPlanner(Message):
    """Ask the planner for a new plan for the rest of a mission; its answer comes back as an event."""

    kind: Literal["ask_planner"] = "ask_planner"
    request: ReplanMission


@dataclass(frozen=True, slots=True)
class PublishMission:
    """A mission changed."""

    mission: Mission

    @property
    def state(self) -> MissionState:
        """What is published of it; written down when asked for, since robots need not wait for that."""
        return mission_state(self.mission)


@dataclass(frozen=True, slots=True)
class PublishTask:
    """A task changed."""

    task: Task

    @property
    def state(self) -> TaskState:
        """What is published of it; written down when asked for."""
        return task_state(self.task)


class RetractTask(Message):
    """The task is no more (a plan that waited for approval was edited)."""

    kind: Literal["retract_task"] = "retract_task"
    mission_id: Id
    task_id: Id


class RetractMission(Message):
    """The mission has ended long ago and is not told of on the bus any more."""

    kind: Literal["retract_mission"] = "retract_mission"
    mission_id: Id


class PublishAreas(Message):
    """The area rules changed."""

    kind: Literal["publish_areas"] = "publish_areas"
    rules: AreaRules


class LookFor(Message):
    """Ask the cameras for objects that a task waits for."""

    kind: Literal["look_for"] = "look_for"
    objects: tuple[Id, ...]


Effect = (
    Send
    | Hush
    | SendStop
    | HushStop
    | Acknowledge
    | AskPlanner
    | PublishMission
    | PublishTask
    | RetractTask
    | RetractMission
    | PublishAreas
    | LookFor
)
