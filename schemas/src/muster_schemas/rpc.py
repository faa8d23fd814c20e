"""Requests and replies of the scheduler's queries, and the one error reply of all queries."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from .base import Message
from .ids import Id
from .mission import Approval, InstructionText, MissionStatus, MissionView, Priority, Reason
from .plan import Plan, PlanTask


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
    RETRY = "retry"
    """A task that failed and waits for a decision: once more."""
    SKIP = "skip"
    """The same task: go on without it."""
    REPLAN = "replan"
    """The same task: have the planner make a new plan for it and what comes after it."""


class ControlMission(Message):
    """An action on one mission; doing it twice equals doing it once."""

    mission_id: Id
    action: MissionAction
    plan: Plan | None = None
    plan_revision: int | None = Field(
        default=None,
        ge=0,
        description="of the plan that was edited; set_plan is refused if it is not the newest any more",
    )
    task_id: Id | None = Field(default=None, description="for retry, skip and replan")
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


class ReplanMission(Message):
    """Asks the planner for a new plan for the rest of a mission: for the task that failed and those after it."""

    mission_id: Id
    task_id: Id = Field(description="of the task that failed")
    number: int = Field(ge=1, description="counts the mission's replans")
    text: InstructionText
    priority: Priority = 5
    done: tuple[PlanTask, ...] = Field(default=(), description="tasks that have succeeded; they stay done")
    going_on: tuple[PlanTask, ...] = Field(default=(), description="tasks of other branches, which go on as planned")
    failed: PlanTask
    error: str = Field(max_length=1000, description="why it failed")
    rest: tuple[PlanTask, ...] = Field(
        default=(), description="what was planned after it and will not be done that way"
    )


class ReplanReply(Message):
    """The new plan for the rest, whose tasks depend on each other only; or the reasons why there is none."""

    plan: Plan | None = None
    reasons: tuple[Reason, ...] = ()


class RulesQuery(Message):
    """Asks for the area rules that hold."""
