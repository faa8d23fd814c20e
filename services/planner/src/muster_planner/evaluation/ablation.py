"""Plans without their dependencies, for the paper's ablation: what is left of the order is the order of the list.

The paper does not say how a plan without a graph is run, so there are two readings, and both are measured.
"""

from enum import StrEnum

from muster_schemas.plan import Plan, PlanTask

from .fleet import Fleet


class Reading(StrEnum):
    """How tasks without dependencies are run."""

    QUEUES = "queues"
    """Each robot does its tasks in the order of the list; robots do not wait for one another."""
    LIST = "list"
    """One task after another, as in a plain list."""


def without_dependencies(plan: Plan, fleet: Fleet, reading: Reading) -> Plan:
    """Return the plan's tasks in their order, waiting only for what the reading makes of that order."""
    tasks: list[PlanTask] = []
    last: dict[str, str] = {}
    for task in plan.tasks:
        function = task.instruction_function
        queues = fleet.meant_by(function) if reading is Reading.QUEUES else ("the list",)
        before = tuple(dict.fromkeys(last[q] for q in queues if q in last))
        last |= dict.fromkeys(queues, task.task)
        waiting = function.model_copy(update={"dependencies": before})
        tasks.append(task.model_copy(update={"instruction_function": waiting}))
    return Plan(tasks=tuple(tasks))
