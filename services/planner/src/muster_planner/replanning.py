"""New plans for the rest of a mission: what is left is said in plain words, and planned as any instruction is.

A small model gets just those words. A large one is told beside them what was done, what failed and why.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Final, Literal

from muster_schemas.plan import InstructionFunction, PlanTask
from muster_schemas.robot import RobotCard
from muster_schemas.rpc import ReplanMission
from muster_schemas.skills import Catalogue

_SAID: Final[Mapping[str, tuple[str, str]]] = {
    "go": ("goes to {at}", "go to {at}"),
    "home": ("goes back to the start", "go back to the start"),
    "dig": ("digs{at_place}", "dig{at_place}"),
    "dump": ("unloads{at_place}", "unload{at_place}"),
    "load": ("gets loaded{at_place}", "get loaded{at_place}"),
    "tip": ("tips{at_place}", "tip{at_place}"),
    "avoid": ("avoids {at}", "avoid {at}"),
    "allow": ("may enter {at} again", "may enter {at} again"),
}
"""By the skill's verb: of one robot, and of several."""


def rest_in_words(question: ReplanMission, roster: Collection[RobotCard], catalogue: Catalogue) -> str:
    """Return an instruction for what is left: the task that failed, and those after it in their order.

    A robot that the plan names but that is not there any more becomes any robot of its type.
    """
    types = {c.robot_id: c.type for c in roster}
    left = [question.failed, *_in_order(question.rest)]
    clauses = [_clause(task, types, catalogue) for task in left]
    return f"{', then '.join(clauses)}."[:1990]


def background(question: ReplanMission) -> str:
    """Return what a model that reads more than an instruction should know of the mission."""
    lines = [f"This is the rest of a mission that was: {question.text}"]
    lines += [f"Already done: {_names(question.done)}."] if question.done else []
    lines += [f"Goes on meanwhile: {_names(question.going_on)}."] if question.going_on else []
    lines += [
        f"Failed: {_names([question.failed])}, because: {question.error}",
        "Plan only what is left. Do it another way if the same way would fail again. Depend on new tasks only.",
    ]
    return "\n".join(lines)


def _in_order(tasks: Sequence[PlanTask]) -> list[PlanTask]:
    """Return tasks with each after what it depends on (plans may be written backwards)."""
    left, ordered = {t.task: t for t in tasks}, list[PlanTask]()
    while left:
        ready = [t for t in left.values() if not set(t.instruction_function.dependencies) & left.keys()]
        for task in ready or list(left.values()):
            ordered.append(left.pop(task.task))
    return ordered


def _names(tasks: Sequence[PlanTask]) -> str:
    return "; ".join(_name(t.task, t.instruction_function) for t in tasks)


def _name(name: str, function: InstructionFunction) -> str:
    who = ", ".join(function.robot_ids or function.robot_type) or "all"
    at = f" at {', '.join(function.object_keywords)}" if function.object_keywords else ""
    return f"{name} ({function.name} by {who}{at})"


def _clause(task: PlanTask, types: Mapping[str, str], catalogue: Catalogue) -> str:
    function = task.instruction_function
    skill = catalogue[function.name]
    at = " and ".join(_spaced(o) for o in function.object_keywords)
    who = _who(function, types, fleet_wide=skill.fleet_wide)
    of_one, of_several = _SAID.get(skill.verb, (f"does {skill.name}", f"do {skill.name}"))
    said = of_several if " and " in who or who[0].isdigit() else of_one
    return f"{who} {said.format(at=at, at_place=f' at {at}' if at else '')}"


def _who(function: InstructionFunction, types: Mapping[str, str], *, fleet_wide: bool) -> str:
    if fleet_wide or not (function.robot_ids or function.robot_type):
        return "every robot"
    named = [_robot(r, types) for r in function.robot_ids]
    count = function.robot_count
    return " and ".join([*named, *(_some(count, _spaced(t)) for t in function.robot_type)])


def _some(count: int | Literal["all"] | None, kind: str) -> str:
    if count == "all":
        return f"every {kind}"
    return f"one {kind}" if count in (None, 1) else f"{count} {kind}s"


def _robot(robot_id: str, types: Mapping[str, str]) -> str:
    match = re.fullmatch(r"(?:robot_)?(.+?)_0*(\d+)", robot_id)
    if match is None:
        return robot_id
    kind, number = match.groups()
    return f"{_spaced(kind)} {number}" if robot_id in types else f"one {_spaced(kind)}"


def _spaced(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=\d)", " ", name.replace("_", " "))
