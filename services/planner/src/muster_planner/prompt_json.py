"""The prompt and the answer's JSON Schema for large models that write the published plan form.

Everything about the site is filled in from the request: robots from their cards, objects from the map, skills from the
catalogue. The rules say what operators' words mean here.
"""

import json
from collections.abc import Iterable, Sequence
from typing import Any, cast

from muster_schemas.plan import MAX_TASKS, InstructionFunction, Plan, PlanTask
from muster_schemas.skills import ObjectNeed, Skill
from pydantic import ValidationError

from .errors import UnusableAnswerError
from .llm import PlanRequest
from .published import published_form

_RULES = """\
Rules:
1. Plan only what is asked for, literally or by plain implication. Add no further steps.
2. To inspect, check or look at an object is to drive there.
3. To clear or remove a solid object is that the robot drives to it and then picks it up with its digging skill; only
   if it is said to put or dump it somewhere does the unloading skill follow.
4. To dig or work at an object is to drive there first, unless the robot is said to be there. With no place named, the
   skill stands alone.
5. To load soil into a truck at a place: both drive there; the digger digs once it is there; it unloads once it has
   dug and the truck is there. A loading task of the truck itself exists only if the truck is said to load or be
   loaded; it needs the truck to be there and the digging done, and runs beside the unloading.
6. To haul something somewhere and tip it is that the truck drives there after the loading and then unloads.
7. To go back or go home is the return_to_start skill. To avoid or keep away from is the avoid_areas skill; "safe
   again" or "open" is the allow_areas skill.
8. Words of order (then, after, before, once, finally) become dependencies, also when said in reverse. Actions of one
   robot in a row depend on each other. Clauses with no order between them do not depend on each other.
9. A rule about areas comes before the movements only if the words say so.
10. For the whole fleet use the skill that ends in _for_all_robots and name no robots. For all robots of a type give
    robot_type and robot_count "all"; for a number of them give robot_type and that number; else give robot_ids.
    Never give both robot_ids and robot_type.
11. An object without a number is number 1 of its class. Use the objects' names exactly as listed; an object that is
    said but not listed keeps the name that it would have (class and number), and is looked for.
12. Task names are unique, such as "drive_1". dependencies lists names of tasks of this plan.
If the text is no instruction for these robots, or needs a robot or skill that is not listed, answer \
{"refusal": "why, in one sentence, as told to the operator"} and nothing else. Else answer {"tasks": [...]}."""


def messages(request: PlanRequest) -> list[dict[str, str]]:
    """Return the chat: who is where, the rules, the instruction, and for a repair what was wrong."""
    chat = [
        {"role": "system", "content": _system(request)},
        {"role": "user", "content": "\n\n".join(filter(None, (f"Instruction: {request.text}", request.background)))},
    ]
    feedback = request.feedback
    if feedback is not None:
        before = json.dumps(published_form(feedback.plan)) if feedback.plan else feedback.raw[:4000]
        wrong = "\n".join(f"- {f'{r.task}: ' if r.task else ''}{r.message}" for r in feedback.reasons)
        chat += [
            {"role": "assistant", "content": before or "{}"},
            {"role": "user", "content": f"That cannot run on this site:\n{wrong}\nAnswer again, corrected."},
        ]
    return chat


def answer_schema(request: PlanRequest) -> dict[str, Any]:
    """Return the JSON Schema of an answer: a plan in the published form, or a refusal.

    Robots, types and skills are closed lists; objects are not, because the cameras may yet find one.
    """
    name = {"type": "string", "minLength": 1, "maxLength": 64}

    def some(values: Iterable[str]) -> dict[str, Any]:
        listed = sorted(set(values))
        return {"type": "array", "items": {"type": "string", "enum": listed} if listed else name}

    function = {
        "type": "object",
        "properties": {
            "name": {"type": "string", "enum": [_said(s) for s in _usable(request)]},
            "robot_ids": some(c.robot_id for c in request.roster),
            "robot_type": some(c.type for c in request.roster),
            "robot_count": {"anyOf": [{"type": "integer", "minimum": 1}, {"type": "string", "enum": ["all"]}]},
            "dependencies": {"type": "array", "items": name},
            "object_keywords": {"type": "array", "items": name},
        },
        "required": ["name", "dependencies", "object_keywords"],
        "additionalProperties": False,
    }
    task = {
        "type": "object",
        "properties": {"task": name, "instruction_function": function},
        "required": ["task", "instruction_function"],
        "additionalProperties": False,
    }
    tasks = {"type": "array", "items": task, "minItems": 1, "maxItems": MAX_TASKS}
    return {
        "anyOf": [
            _only("tasks", tasks),
            _only("refusal", {"type": "string", "minLength": 1, "maxLength": 500}),
        ]
    }


def strict_schema(request: PlanRequest) -> dict[str, Any]:
    """Return `answer_schema` in the part of JSON Schema that OpenAI's and Anthropic's own services hold models to.

    One object with every field required; what may be left out may be null. No limits of length, which they refuse.
    """
    plan, refusal = answer_schema(request)["anyOf"]
    both: dict[str, Any] = {**plan, "properties": {**plan["properties"], **refusal["properties"]}, "required": []}
    return cast("dict[str, Any]", _strict(both))


def _strict(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_strict(one) for one in cast("list[Any]", schema)]
    if not isinstance(schema, dict):
        return schema
    fields = cast("dict[str, Any]", schema)
    kept = {k: v if k == "enum" else _strict(v) for k, v in fields.items() if k not in _LIMITS}
    if "properties" in kept:
        optional = set(kept["properties"]) - set(fields["required"])
        for name in optional:
            kept["properties"][name] = {"anyOf": [kept["properties"][name], {"type": "null"}]}
        kept["required"] = list(kept["properties"])
    return kept


_LIMITS = frozenset({"minLength", "maxLength", "minItems", "maxItems", "minimum"})


def _without_nulls(data: Any) -> Any:
    if isinstance(data, list):
        return [_without_nulls(one) for one in cast("list[Any]", data)]
    if isinstance(data, dict):
        return {k: _without_nulls(v) for k, v in cast("dict[str, Any]", data).items() if v is not None}
    return data


def parse_answer(raw: str) -> Plan | str:
    """Return the plan that the answer holds, or the text of its refusal.

    Raises:
        UnusableAnswerError: it is neither.

    """
    try:
        data: Any = _without_nulls(json.loads(raw))
    except (ValueError, RecursionError) as error:
        raise UnusableAnswerError("The model did not answer in JSON. Send it again, or say it shorter.") from error
    if isinstance(data, dict):
        fields = cast("dict[str, Any]", data)
        refusal = fields.get("refusal")
        if isinstance(refusal, str) and refusal.strip():
            return refusal.strip()
    try:
        return Plan.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the answer"
        raise UnusableAnswerError(f"The model's answer is no plan: {where}: {first['msg']}.") from error


def _only(field: str, schema: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": {field: schema}, "required": [field], "additionalProperties": False}


def _system(request: PlanRequest) -> str:
    robots = "\n".join(f"- {c.robot_id}: {c.type}" for c in request.roster) or "- none"
    objects = ", ".join(request.objects) or "none seen yet"
    skills = "\n".join(_skill_line(s) for s in _usable(request)) or "- none"
    return "\n\n".join(
        (
            "You turn one instruction of a site operator into a plan: a graph of robot skills, as JSON.",
            f"Robots on the site now:\n{robots}",
            f"Objects on the map now: {objects}",
            f"Skills:\n{skills}",
            _RULES,
            *_example(request),
        )
    )


def _usable(request: PlanRequest) -> list[Skill]:
    """Return the skills that some robot here has, and those of the whole fleet."""
    had = {name for card in request.roster for name in card.skills}
    return [s for s in request.catalogue if s.name in had or s.fleet_wide]


def _said(skill: Skill) -> str:
    """Return the name of a skill in the published form: its first alias, if it has one."""
    return skill.aliases[0] if skill.aliases else skill.name


def _skill_line(skill: Skill) -> str:
    who = f" ({', '.join(skill.robot_types)} only)" if skill.robot_types else ""
    objects = {
        ObjectNeed.REQUIRED: "needs an object",
        ObjectNeed.OPTIONAL: "object if known",
        ObjectNeed.NONE: "takes no object",
    }[skill.objects]
    return f"- {_said(skill)}{who}: {skill.text}; {objects}"


def _example(request: PlanRequest) -> Sequence[str]:
    """Return one worked example about this site's own robots; none if a skill or object for it is missing."""
    skills = {s.name: s for s in _usable(request)}
    go = next((s for s in skills.values() if s.verb == "go" and not s.fleet_wide), None)
    for card in request.roster:
        work = next((skills[n] for n in card.skills if n in skills and skills[n].robot_types), None)
        if go and work and request.objects:
            place = request.objects[0]
            plan = Plan(
                tasks=(
                    _task("drive_1", go, card.robot_id, place, after=()),
                    _task("work_1", work, card.robot_id, place, after=("drive_1",)),
                )
            )
            said = f"{card.robot_id} drives to {place}, then: {work.text}"
            return (f"Example. Instruction: {said}\nAnswer: {json.dumps(published_form(plan))}",)
    return ()


def _task(name: str, skill: Skill, robot_id: str, place: str, *, after: tuple[str, ...]) -> PlanTask:
    objects = () if skill.objects is ObjectNeed.NONE else (place,)
    function = InstructionFunction(
        name=_said(skill), robot_ids=(robot_id,), dependencies=after, object_keywords=objects
    )
    return PlanTask(task=name, instruction_function=function)
