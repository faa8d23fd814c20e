"""Requests and replies of the scheduler's queries, and the one error reply of all queries."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from .base import Message
from .ids import Id
from .mission import Approval, InstructionText, MissionStatus, MissionView, Priority, Reason
from .plan import Plan


class ErrorCode(StrEnum):
    """Who must act: the caller (INVALID, NOT_FOUND, CONFLICT) or the site (UNAVAILABLE, INTERNAL)."""

    INVALID = "invalid"
    NOT_FOUND = "not_found"
    CONFLICT = "conflict"
    UNAVAILABLE = "unavailable"
    INTERNAL = "internal"


class ErrorReply(Message):
    """Why a query was not done; nothing has changed."""

    code: ErrorCode
    message: str = Field(max_length=2000)
    reasons: tuple[Reason, ...] = ()


class SubmitMission(Message):
    """A new mission: with a plan it goes through the gate at once, without one it waits for the planner.

    The same `idempotency_key` again returns the mission that the first one made.
    """

    text: InstructionText
    plan: Plan | None = None
    priority: Priority = 5
    approval: Approval = "auto"
    idempotency_key: Annotated[str, Field(min_length=1, max_length=128)] | None = None


class MissionAction(StrEnum):
    """What can be done to a mission."""

    SET_PLAN = "set_plan"
    """By the planner, while planning, or by a person who edits a plan that awaits approval."""
    REFUSE = "refuse"
    """By the planner: it cannot be planned."""
    APPROVE = "approve"
    REJECT = "reject"
    CANCEL = "cancel"
    PAUSE = "pause"
    RESUME = "resume"


class ControlMission(Message):
    """An action on one mission; doing it twice equals doing it once."""

    mission_id: Id
    action: MissionAction
    plan: Plan | None = None
    reasons: tuple[Reason, ...] = ()


class ControlReply(Message):
    """The mission after it; `robots` says per robot what is known, such as 'stopped' or 'no answer yet'."""

    mission_id: Id
    state: MissionStatus
    robots: dict[Id, str] = Field(default_factory=dict)


class MissionsQuery(Message):
    """One mission, or the newest ones."""

    mission_id: Id | None = None
    states: tuple[MissionStatus, ...] = Field(default=(), description="only missions in these states; empty: all")
    limit: int = Field(default=100, ge=1, le=1000)


class MissionsReply(Message):
    """Newest first."""

    missions: tuple[MissionView, ...]


class RulesQuery(Message):
    """Asks for the area rules that hold."""
