"""What a site decides beforehand: what is done when a task fails, and which plans wait for a person."""

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from .base import Message

Pause = Annotated[float, Field(ge=0, le=86_400)]


class _Strict(Message):
    """Written by people, so a misspelt field is an error."""

    model_config = ConfigDict(extra="forbid")


class Measure(StrEnum):
    """What may be done about a task that repeating it did not help."""

    REASSIGN = "reassign"
    """Give it to other able robots; only where the plan names none and its choice has not begun to work."""
    REPLAN = "replan"
    """Have the planner make a new plan for it and for what comes after it."""
    ASK = "ask"
    """Hold it until a person says: retry, skip, replan, or cancel the mission."""


class FailurePolicy(_Strict):
    """What is done about a task that fails. What is left out is as the wider policy has it: the skill's, the site's."""

    retries: int | None = Field(
        default=None, ge=0, le=100, description="new attempts after a failed one; built in: 1, and 0 for soil work"
    )
    retry_after_s: Pause | None = Field(
        default=None, description="pause before the first; it doubles with each further one, up to a minute"
    )
    then: Annotated[tuple[Measure, ...], Field(max_length=8)] | None = Field(
        default=None, description="taken one after the other until one helps; at their end the task has failed"
    )
    timeout_s: Annotated[float, Field(gt=0, le=86_400)] | None = Field(
        default=None,
        description="site time after which the robot halts and the attempt has failed; built in: the skill's",
    )

    def over(self, wider: "FailurePolicy") -> "FailurePolicy":
        """Return this policy with what it leaves out taken from a wider one."""
        return wider.model_copy(update=self.model_dump(exclude_none=True))


class FailurePolicies(_Strict):
    """A site's."""

    default: FailurePolicy = FailurePolicy()
    skills: dict[str, FailurePolicy] = Field(default_factory=dict, description="by the skill's name or alias")
    replans: int = Field(default=2, ge=0, le=20, description="new plans that one mission may have")
    lost_after_s: Pause | None = Field(
        default=None,
        description="how long a lost robot is waited for before its task has failed; left out: until it is back",
    )


class AskForAllRobots(_Strict):
    """The plan moves every robot of the site."""

    ask_if: Literal["all_robots"]


class AskForManyRobots(_Strict):
    """The plan moves more than `robots` robots."""

    ask_if: Literal["more_robots_than"]
    robots: int = Field(ge=0, le=10_000)


class AskForSkill(_Strict):
    """The plan uses a skill."""

    ask_if: Literal["skill"]
    skill: Annotated[str, Field(min_length=1, max_length=64, description="its name or an alias")]


ApprovalRule = Annotated[AskForAllRobots | AskForManyRobots | AskForSkill, Field(discriminator="ask_if")]
"""A plan to which a rule applies waits for a person, whatever was asked for."""
