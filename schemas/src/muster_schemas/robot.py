"""What the scheduler and a robot's agent say to each other, and what the agent tells of its robot.

A robot of another maker needs only these models (exported as JSON Schemas): announce a `RobotCard`, publish
`RobotState`, obey `SkillRequest`, answer with `SkillStatus` until its final one is acknowledged.
"""

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field

from .base import Message, Point, Pose, Seconds, UnixTime
from .ids import Id


class RobotCard(Message):
    """Who a robot is and what it can do; its current life is `boot_id`."""

    robot_id: Id
    boot_id: Id
    type: Id
    skills: tuple[Id, ...] = Field(description="names from the catalogue")
    home: Pose
    length_m: float = Field(gt=0, le=100)
    width_m: float = Field(gt=0, le=100)
    max_speed_mps: float = Field(gt=0, le=50)
    reach_m: float = Field(default=0.0, ge=0, description="farthest point that its tool reaches from its centre")
    capacity_m3: float = Field(default=0.0, ge=0, description="of its bucket or bed")

    @property
    def radius_m(self) -> float:
        """Radius of the circle that holds its footprint."""
        return (self.length_m**2 + self.width_m**2) ** 0.5 / 2


class Load(Message):
    """What is in a bucket or bed."""

    soil_m3: float = Field(default=0.0, ge=0)
    bodies: tuple[Id, ...] = Field(default=(), description="solid things, such as an obstacle that was picked up")

    @property
    def empty(self) -> bool:
        """Whether nothing is in it (a spoonful of soil does not count)."""
        return self.soil_m3 < 0.01 and not self.bodies


class TaskRef(Message):
    """One attempt at one task."""

    mission_id: Id
    task_id: Id
    attempt: int = Field(ge=1)


class RobotState(Message):
    """A robot now. Published by the agent's main loop, so its coming is the agent's heartbeat."""

    robot_id: Id
    boot_id: Id
    seq: int = Field(ge=0)
    pose: Pose
    speed_mps: float = 0.0
    load: Load = Load()
    busy_with: TaskRef | None = None
    path: Annotated[tuple[Point, ...], Field(max_length=256)] = Field(
        default=(), description="where it is about to drive, so that others plan around it"
    )
    rules_revision: int = Field(default=0, ge=0, description="of the area rules that it obeys")
    fault: str | None = Field(default=None, max_length=400)
    stopped: bool = Field(default=False, description="a person has stopped it: it starts nothing until it is released")
    at: UnixTime


class TargetObject(Message):
    """An object as the map had it at dispatch."""

    name: Id
    object_class: str = Field(max_length=64)
    position: Point
    radius_m: float = Field(ge=0, le=1000, description="of the circle around `position` that holds it")


class RequestAction(StrEnum):
    """What a request asks the agent to do about (mission, task, attempt)."""

    PREPARE = "prepare"
    """Part of a team task: accept and keep still, or refuse; `start` comes once all of the team have accepted."""
    START = "start"
    CANCEL = "cancel"
    PAUSE = "pause"
    RESUME = "resume"
    QUERY = "query"


class SkillRequest(Message):
    """A command to one life of one robot; sent again until answered, so obeying it twice must equal once."""

    action: RequestAction = RequestAction.START
    mission_id: Id
    task_id: Id
    attempt: int = Field(ge=1)
    epoch: int = Field(ge=1, description="of the scheduler; a lower one than seen before is refused")
    robot_id: Id
    boot_id: Id = Field(description="the life of the agent that this is meant for; another one refuses it")
    skill: Id
    issued_at: UnixTime
    deadline: UnixTime = Field(description="a start that arrives later is refused")
    timeout_s: Seconds = Field(default=600.0, description="site time that the skill may take once started")
    objects: tuple[TargetObject, ...] = ()
    goals: tuple[Pose, ...] = Field(default=(), description="for driving: where to stand, one for each object in turn")
    partner: Id | None = Field(default=None, description="the truck to unload into, or the excavator that loads")
    rules_revision: int | None = Field(default=None, description="for area rules: done once this one is obeyed")

    @property
    def ref(self) -> TaskRef:
        """The attempt that this is about."""
        return TaskRef(mission_id=self.mission_id, task_id=self.task_id, attempt=self.attempt)


class SkillStatusKind(StrEnum):
    """How an attempt stands at the agent."""

    ACCEPTED = "accepted"
    REFUSED = "refused"
    STARTED = "started"
    PROGRESS = "progress"
    PAUSED = "paused"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"
    INTERRUPTED = "interrupted"
    """The agent restarted while it was under way: the machine stands still, how far it came is not known."""
    UNKNOWN = "unknown"
    """The answer to a query or cancel about an attempt never seen; a later start of it will be refused."""

    @property
    def final(self) -> bool:
        """Whether the attempt is over; such a status is repeated until acknowledged."""
        return self not in (self.ACCEPTED, self.STARTED, self.PROGRESS, self.PAUSED)


class SkillStatus(Message):
    """An agent's word on an attempt; `seq` grows within one attempt, so late and repeated ones are seen."""

    mission_id: Id
    task_id: Id
    attempt: int = Field(ge=1)
    epoch: int = Field(ge=1)
    robot_id: Id
    boot_id: Id
    skill: Id
    seq: int = Field(ge=0)
    state: SkillStatusKind
    progress: float = Field(default=0.0, ge=0, le=1)
    reason: str | None = Field(default=None, max_length=1000)
    at: UnixTime


class StatusAck(Message):
    """The scheduler has written the status `seq` of this attempt to its journal."""

    mission_id: Id
    task_id: Id
    attempt: int = Field(ge=1)
    robot_id: Id
    boot_id: Id
    seq: int = Field(ge=0)
    epoch: int = Field(ge=1)
    kind: Literal["ack"] = "ack"
