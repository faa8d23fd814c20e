"""The compact language in which the embedded model answers: one short line a task.

    a go E1 T1 @ soil1              label verb robots [@ objects] [< labels of the tasks to wait for]
    b dig E1 @ soil1 < a
    c tip T* @ puddle1 < a b        T*: all of a type; T:2: so many of it; all: the whole fleet

or `refuse REASON`. Labels are a .. z, aa, ab, ...; verbs stand in the catalogue, short names in `SiteNames`.
`encode` and `decode` lose nothing of a plan but its tasks' names.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from muster_schemas.plan import InstructionFunction, Plan, PlanTask
from muster_schemas.skills import Skill

from .short_names import SiteNames

_REFUSAL = re.compile(r"refuse(?: (?P<reason>.*))?", re.DOTALL)
_LINE = re.compile(r"(?P<label>[a-z]{1,2}) (?P<verb>[a-z0-9_-]+) (?P<robots>[^@<]+?)(?: @ (?P<objects>[^@<]+?))?"
                   r"(?: < (?P<before>[a-z ]+))?")  # fmt: skip
_OF_TYPE = re.compile(r"(?P<letter>[A-Z]{1,2})(?P<count>\*|:\d{1,4})")


class PlanLanguageError(ValueError):
    """A text that is no answer in the plan language, or a plan that it cannot say; the message says where and why."""


@dataclass(frozen=True)
class Refusal:
    """Why there is no plan."""

    reason: str


def label(position: int) -> str:
    """Return the label of the task at a position (from 0): a .. z, aa, ab, ..."""
    return (label(position // 26 - 1) if position >= 26 else "") + chr(ord("a") + position % 26)


def published_name(skill: Skill) -> str:
    """Return the skill's name as the published data set writes it: `Excavation` for `excavator_digging`."""
    return skill.aliases[0] if skill.aliases else skill.name


def encode(plan: Plan, names: SiteNames) -> str:
    """Return the plan in the plan language.

    Raises:
        PlanLanguageError: it names a robot, type, skill or task that is not there, or robots in a way that the
            language lacks (a count over several types).

    """
    labels = {task.task: label(n) for n, task in enumerate(plan.tasks)}
    lines: list[str] = []
    for task in plan.tasks:
        function = task.instruction_function
        if function.name not in names.catalogue:
            raise PlanLanguageError(f"{task.task}: there is no skill {function.name!r}")
        skill = names.catalogue[function.name]
        line = f"{labels[task.task]} {skill.verb} {_robots_said(task, skill, names)}"
        if function.object_keywords:
            line += f" @ {' '.join(function.object_keywords)}"
        if function.dependencies:
            missing = [d for d in function.dependencies if d not in labels]
            if missing:
                raise PlanLanguageError(f"{task.task} waits for {missing[0]!r}, which is not in the plan")
            line += f" < {' '.join(labels[d] for d in function.dependencies)}"
        lines.append(line)
    return "\n".join(lines)


def _robots_said(task: PlanTask, skill: Skill, names: SiteNames) -> str:
    function = task.instruction_function
    if skill.fleet_wide:
        return "all"
    if function.robot_ids:
        unknown = [r for r in function.robot_ids if r not in names.short_names]
        if unknown:
            raise PlanLanguageError(f"{task.task}: there is no robot {unknown[0]!r}")
        return " ".join(names.short_names[r] for r in function.robot_ids)
    if not function.robot_type:
        raise PlanLanguageError(f"{task.task} does not say which robots")
    unknown = [t for t in function.robot_type if t not in names.letters]
    if unknown:
        raise PlanLanguageError(f"{task.task}: there is no robot of type {unknown[0]!r}")
    letters = [names.letters[t] for t in function.robot_type]
    if isinstance(function.robot_count, int):
        if len(letters) > 1:
            raise PlanLanguageError(f"{task.task}: {function.robot_count} robots of several types cannot be said")
        return f"{letters[0]}:{function.robot_count}"
    return " ".join(f"{letter}*" for letter in letters)


def decode(text: str, names: SiteNames) -> Plan | Refusal:
    """Read an answer: a plan in the published form (tasks named `Excavation_2`), or a refusal.

    Whether the plan may run is the gate's to say; here only what cannot be written down is an error.

    Raises:
        PlanLanguageError: a line does not have the language's form, or names what is not there.

    """
    refusal = _REFUSAL.fullmatch(text.strip())
    if refusal:
        return Refusal((refusal["reason"] or "").strip() or "it cannot be done here")
    lines = [line.strip() for line in text.strip().splitlines() if line.strip()]
    if not lines:
        raise PlanLanguageError("the answer is empty")
    parsed = [_parsed(line, position) for position, line in enumerate(lines)]
    functions = [_function(match, names) for match in parsed]
    task_names = {
        match["label"]: f"{f.name}_{n}" for n, (match, f) in enumerate(zip(parsed, functions, strict=True), 1)
    }
    tasks: list[PlanTask] = []
    for match, function in zip(parsed, functions, strict=True):
        before = _unique((match["before"] or "").split())
        unknown = [b for b in before if b not in task_names]
        if unknown:
            raise PlanLanguageError(f"line {match[0]!r} waits for {unknown[0]!r}, which is no line's label")
        dependencies = tuple(task_names[b] for b in before)
        tasks.append(
            PlanTask(
                task=task_names[match["label"]],
                instruction_function=function.model_copy(update={"dependencies": dependencies}),
            )
        )
    return Plan(tasks=tuple(tasks))


def _parsed(line: str, position: int) -> re.Match[str]:
    match = _LINE.fullmatch(line)
    if match is None:
        raise PlanLanguageError(f"{line!r} is not 'label verb robots @ objects < labels'")
    if match["label"] != label(position):
        raise PlanLanguageError(f"line {line!r} must have the label {label(position)!r}")
    return match


def _function(match: re.Match[str], names: SiteNames) -> InstructionFunction:
    robots, objects = _unique(match["robots"].split()), _unique((match["objects"] or "").split())
    skill = names.catalogue.by_verb.get((match["verb"], robots == ("all",)))
    if skill is None:
        who = "the whole fleet" if robots == ("all",) else "single robots"
        raise PlanLanguageError(f"{match[0]!r}: there is no verb {match['verb']!r} for {who}")
    unknown = [o for o in objects if o not in names.objects]
    if unknown:
        raise PlanLanguageError(f"{match[0]!r}: there is no object {unknown[0]!r}")
    name = published_name(skill)
    if robots == ("all",):
        types = tuple(sorted(names.letters))
        return InstructionFunction(name=name, robot_type=types, robot_count="all", object_keywords=objects)
    groups = [_OF_TYPE.fullmatch(r) for r in robots]
    found = [g for g in groups if g]
    if not found:
        missing = [r for r in robots if r not in names.robot_ids]
        if missing:
            raise PlanLanguageError(f"{match[0]!r}: there is no robot {missing[0]!r}")
        return InstructionFunction(
            name=name, robot_ids=tuple(names.robot_ids[r] for r in robots), object_keywords=objects
        )
    counts = {g["count"] for g in found}
    if len(found) != len(robots) or len(counts) > 1 or (len(found) > 1 and counts != {"*"}):
        raise PlanLanguageError(f"{match[0]!r}: name robots one by one, or by type, not both")
    missing = [g["letter"] for g in found if g["letter"] not in names.types]
    if missing:
        raise PlanLanguageError(f"{match[0]!r}: there is no type {missing[0]!r}")
    count = counts.pop()
    return InstructionFunction(
        name=name,
        robot_type=tuple(names.types[g["letter"]] for g in found),
        robot_count="all" if count == "*" else int(count[1:]),
        object_keywords=objects,
    )


def _unique(items: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(items))
