"""The published DART-LLM plan form, as the authors' data set has it.

    {"tasks": [{"task": name, "instruction_function": {"name": skill, "robot_ids": [...]
        | "robot_type": [...] + "robot_count": n | "all", "dependencies": [names], "object_keywords": [...]}}]}

`object_keywords` may also stand beside `instruction_function`; both places are read, one is written. A person may add
`on_failure` beside it: what is done when this task fails.
A plan that parses is well formed, not yet allowed: see `gate.check_plan`.
"""

from typing import Annotated, Any, Literal, cast

from pydantic import BeforeValidator, Field, model_validator

from .base import Message
from .policies import FailurePolicy
from .skills import PAPER_CATALOGUE

MAX_TASKS = 100

Name = Annotated[str, Field(min_length=1, max_length=64)]


def _as_list(value: object) -> object:
    """Accept a single name without brackets, as the data set sometimes has it."""
    if value is None:
        return []
    return [value] if isinstance(value, str) else value


Names = Annotated[tuple[Name, ...], BeforeValidator(_as_list), Field(max_length=MAX_TASKS)]


class InstructionFunction(Message):
    """Which skill, by which robots, after which tasks, at which objects."""

    name: Name
    robot_ids: Names = ()
    robot_type: Names = ()
    robot_count: Annotated[int, Field(ge=1, le=10_000)] | Literal["all"] | None = None
    dependencies: Names = ()
    object_keywords: Names = ()

    @property
    def skill(self) -> str:
        """The paper's name for the skill, whichever alias the plan says."""
        return PAPER_CATALOGUE.canonical(self.name)


class PlanTask(Message):
    """One node of the graph; `task` is its name, unique in the plan."""

    task: Name
    instruction_function: InstructionFunction
    on_failure: FailurePolicy | None = None

    @model_validator(mode="before")
    @classmethod
    def _object_keywords_beside(cls, data: object) -> object:
        if not isinstance(data, dict):
            return data
        fields = cast("dict[str, Any]", data)
        inner = fields.get("instruction_function")
        beside = fields.get("object_keywords")
        if beside and isinstance(inner, dict) and not cast("dict[str, Any]", inner).get("object_keywords"):
            return {**fields, "instruction_function": {**cast("dict[str, Any]", inner), "object_keywords": beside}}
        return fields


class Plan(Message):
    """A graph of tasks, in the order in which the model wrote them."""

    tasks: Annotated[tuple[PlanTask, ...], Field(max_length=MAX_TASKS)]
