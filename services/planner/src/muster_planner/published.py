"""The plan as JSON in the published DART-LLM form, as people and the authors' tools read it."""

from typing import Any

from muster_schemas.plan import Plan


def published_form(plan: Plan) -> dict[str, Any]:
    """Return the plan with the fields that the data set writes: robots in one of the two ways, never both empty."""
    tasks: list[dict[str, Any]] = []
    for task in plan.tasks:
        function = task.instruction_function
        written: dict[str, Any] = {"name": function.name}
        if function.robot_type:
            written["robot_type"] = list(function.robot_type)
        if function.robot_count is not None:
            written["robot_count"] = function.robot_count
        if function.robot_ids or not function.robot_type:
            written["robot_ids"] = list(function.robot_ids)
        written["dependencies"] = list(function.dependencies)
        written["object_keywords"] = list(function.object_keywords)
        entry: dict[str, Any] = {"task": task.task, "instruction_function": written}
        if task.on_failure is not None:
            entry["on_failure"] = task.on_failure.model_dump(mode="json", exclude_none=True)
        tasks.append(entry)
    return {"tasks": tasks}
