"""What the scheduler tells about missions and their tasks."""

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field

from .base import Message, UnixTime
from .ids import Id
from .plan import Plan

MAX_TEXT = 2000
"""Characters of an instruction."""

InstructionText = Annotated[str, Field(min_length=1, max_length=MAX_TEXT)]
Priority = Annotated[int, Field(ge=0, le=9)]
Approval = Literal["auto", "ask"]


class MissionStatus(StrEnum):
    """Where a mission stands."""

    PLANNING = "planning"
    REJECTED = "rejected"
    AWAITING_APPROVAL = "awaiting_approval"
    RUNNING = "running"
    PAUSED = "paused"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def ended(self) -> bool:
        """Whether nothing can happen to it any more."""
        return self in (self.REJECTED, self.SUCCEEDED, self.FAILED, self.CANCELLED)


class TaskStatus(StrEnum):
    """Where a task stands."""

    WAITING = "waiting"
    READY = "ready"
    DISPATCHED = "dispatched"
    RUNNING = "running"
    PAUSED = "paused"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"
    SKIPPED = "skipped"

    @property
    def ended(self) -> bool:
        """Whether nothing can happen to it any more."""
        return self in (self.SUCCEEDED, self.FAILED, self.CANCELLED, self.SKIPPED)


class Reason(Message):
    """Why a plan or request is refused, for a program (`code`) and a person (`message`)."""

    code: Id
    message: str = Field(max_length=1000)
    task: str | None = Field(default=None, max_length=64, description="the plan's name of the task, if it is one's")


class MissionState(Message):
    """One mission; a higher `revision` replaces a lower one."""

    mission_id: Id
    revision: int = Field(ge=0)
    text: str = Field(max_length=MAX_TEXT)
    state: MissionStatus
    priority: Priority = 5
    approval: Approval = "auto"
    reasons: tuple[Reason, ...] = Field(default=(), description="why it waits for approval, was rejected, or failed")
    plan_revision: int = Field(
        default=0, ge=0, description="grows whenever the plan changes; an edit says which it is of"
    )
    created_at: UnixTime
    started_at: UnixTime | None = None
    ended_at: UnixTime | None = None


class TaskState(Message):
    """One task of a mission; a higher `revision` replaces a lower one."""

    mission_id: Id
    task_id: Id
    revision: int = Field(ge=0)
    name: str = Field(max_length=64, description="its name in the plan")
    skill: str = Field(max_length=64)
    state: TaskStatus
    robots: tuple[Id, ...] = Field(default=(), description="bound so far; empty while a selector is open")
    objects: tuple[Id, ...] = ()
    dependencies: tuple[Id, ...] = Field(default=(), description="task ids")
    waiting_for: tuple[str, ...] = Field(
        default=(), description="such as 'dependency: t3', 'robot: robot_dump_truck_01', 'object: soil2', 'approval'"
    )
    attempt: int = Field(default=0, ge=0, description="attempts begun")
    progress: float = Field(default=0.0, ge=0, le=1)
    error: str | None = Field(default=None, max_length=1000)
    ready_at: UnixTime | None = None
    started_at: UnixTime | None = None
    ended_at: UnixTime | None = None


class MissionView(Message):
    """A mission with its plan and tasks: what a person asks for."""

    mission: MissionState
    plan: Plan | None = None
    proposals: dict[Id, Plan] = Field(
        default_factory=dict, description="new plans for the rest that await approval, by the task that failed"
    )
    tasks: tuple[TaskState, ...] = ()
