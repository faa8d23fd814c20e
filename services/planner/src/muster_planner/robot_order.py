"""What one robot does, it does one after the other, in the order in which the plan says it.

People leave that out as self-evident, and a small model forgets it now and then. Rules (avoid, allow) take no time of
a robot's and stay as they are.
"""

from muster_schemas.plan import InstructionFunction, Plan

from .short_names import SiteNames

_RULES = frozenset({"avoid", "allow"})
"""Verbs of the skills that change where robots may be and move none."""


def one_thing_at_a_time(plan: Plan, names: SiteNames) -> Plan:
    """Return the plan with each task waiting for the one before it of the same robot, where it did not already.

    A plan with references to later tasks comes back unchanged: for it, the order of the lines is not that of the work.
    """
    above: dict[str, frozenset[str]] = {}
    last: dict[str, str] = {}
    tasks = list(plan.tasks)
    for n, task in enumerate(tasks):
        function = task.instruction_function
        if any(d not in above for d in function.dependencies):
            return plan
        before = list(function.dependencies)
        implied = frozenset(before).union(*(above[d] for d in before))
        if names.catalogue[function.name].verb not in _RULES:
            for robot in _robots(function, names):
                previous = last.get(robot)
                if previous and previous not in implied:
                    before.append(previous)
                    implied |= above[previous] | {previous}
                last[robot] = task.task
        above[task.task] = implied
        if len(before) > len(function.dependencies):
            waiting = function.model_copy(update={"dependencies": tuple(before)})
            tasks[n] = task.model_copy(update={"instruction_function": waiting})
    return Plan(tasks=tuple(tasks))


def _robots(function: InstructionFunction, names: SiteNames) -> tuple[str, ...]:
    """Return the robots' ids; "two trucks" is one name of its own, since it binds to the same two everywhere."""
    if function.robot_ids:
        return function.robot_ids
    if isinstance(function.robot_count, int):
        return (f"{function.robot_count} of {' '.join(function.robot_type)}",)
    kinds = [k for k in names.kinds if k.type in function.robot_type or not function.robot_type]
    return tuple(full for kind in kinds for full in kind.robots.values())
