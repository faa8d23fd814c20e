"""A data set's cases: instructions with the plans that are right for them, read from three forms of JSON lines.

The published DART-LLM form has one reference plan a case:

    {"ID": "dart_llm-L1-T1-001", "text": ..., "output": {"tasks": [...]}}

Ours names what a plan must hold, with the alternatives that are right too:

    {"id", "level", "text", "tasks": [{"key", "skill": [names], "robots": [ways to say who], "objects": [ways to say
    where], "optional"}], "before": [[key, key]], "unordered": [[key, key]]}

And the short notation of corpora, with one reference plan as well (`plan_language`, but with numbers for labels):

    {"id", "level", "text", "plan": "1 go E1 T1 @ soil1 | 2 dig E1 < 1"}

`"plan": "refuse REASON"`, or in the other forms `"refuse": REASON` in place of the tasks, is an instruction that must
be refused.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self, cast

from muster_schemas.plan import Plan
from muster_schemas.skills import Catalogue, ObjectNeed
from pydantic import BaseModel, Field, ValidationError, model_validator

from muster_planner.plan_language import Refusal, decode, label
from muster_planner.short_names import SiteNames
from muster_planner.surroundings import Surroundings

from .fleet import Fleet

RULES = frozenset({"avoid", "allow"})
"""Verbs that change where robots may be and move none: they take no time of a robot's."""

MAX_LINE = 256 * 1024

_STEP = re.compile(r"(?P<number>\d+) (?P<act>[^<]+?)(?: < (?P<before>\d+(?: \d+)*))?")


class DatasetError(ValueError):
    """A data set that cannot be read; the message says which line and why."""


@dataclass(frozen=True)
class Wanted:
    """One task that a right plan holds."""

    key: str
    verbs: frozenset[str]
    robots: tuple[tuple[str, ...], ...]
    """Ways to say who, each spelled out."""
    objects: tuple[tuple[str, ...], ...]
    """Ways to say where; `()` is to say nothing."""
    optional: bool = False


@dataclass(frozen=True)
class Case:
    """An instruction, and what a right answer to it is."""

    id: str
    level: str
    text: str
    wanted: tuple[Wanted, ...] = ()
    before: tuple[tuple[str, str], ...] = ()
    unordered: tuple[tuple[str, str], ...] = ()
    may_join: frozenset[tuple[str, str]] = frozenset()
    """Unordered pairs that are right as one joint task, too."""
    refuse: str | None = None
    """Why it must be refused; None if there is a plan for it."""
    reference: Plan | None = None
    """The plan that the data set gives, if it gives one."""
    voice: str = ""
    """Who says it, where a data set has several people."""


class _Task(BaseModel):
    key: str
    skill: list[str]
    robots: list[list[str] | dict[str, Any]]
    objects: list[list[str]]
    optional: bool = False


class _Line(BaseModel):
    """The fields of all forms."""

    id: Annotated[str, Field(alias="ID")] = ""
    level: str | None = None
    text: str
    refuse: str | None = None
    tasks: list[_Task] = Field(default_factory=list[_Task])
    before: list[tuple[str, str]] = Field(default_factory=list[tuple[str, str]])
    unordered: list[tuple[str, str]] = Field(default_factory=list[tuple[str, str]])
    output: Plan | None = None
    plan: str | None = None
    voice: str | None = None

    model_config = {"populate_by_name": True, "coerce_numbers_to_str": True}

    @model_validator(mode="after")
    def _keys_are_known(self) -> Self:
        keys = [t.key for t in self.tasks]
        if len(set(keys)) < len(keys):
            raise ValueError("two tasks have one key")
        unknown = {k for pair in (*self.before, *self.unordered) for k in pair} - set(keys)
        if unknown:
            raise ValueError(f"a pair names {sorted(unknown)[0]!r}, which is no task's key")
        return self


def read_cases(path: Path, there: Surroundings) -> list[Case]:
    """Return a file's cases in order, as said on this site.

    Raises:
        DatasetError: it cannot be read, holds no case, or a line is of no form.

    """
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise DatasetError(f"Cannot read {path}: {error.strerror}.") from error
    cases: list[Case] = []
    names = SiteNames(there.roster, there.objects, there.catalogue, there.letters)
    fleet = Fleet.of(there.roster)
    for number, line in enumerate(lines, 1):
        if line.strip():
            try:
                cases.append(_case(line, number, names, fleet))
            except (ValueError, RecursionError) as error:
                raise DatasetError(f"{path}, line {number}: {_told(error)}") from error
    if not cases:
        raise DatasetError(f"{path} holds no case. Each line is one, in a form that docs/evaluation.md shows.")
    twice = {c.id for c in cases if sum(c.id == other.id for other in cases) > 1}
    if twice:
        raise DatasetError(f"{path} has more than one case {sorted(twice)[0]!r}. Give each an id of its own.")
    return cases


def _told(error: Exception) -> str:
    if isinstance(error, ValidationError):
        return "; ".join(f"{'.'.join(map(str, e['loc'])) or 'line'}: {e['msg']}" for e in error.errors()[:3])
    if isinstance(error, json.JSONDecodeError | UnicodeDecodeError | RecursionError):
        return "it is no JSON"
    return str(error)


def _case(text: bytes, number: int, names: SiteNames, fleet: Fleet) -> Case:
    if len(text) > MAX_LINE:
        raise ValueError(f"it has more than {MAX_LINE} bytes")
    line = _Line.model_validate(json.loads(text))
    found = re.search(r"L[0-9]", line.id)
    case_id = line.id or f"line-{number}"
    case = Case(
        id=case_id,
        level=line.level or (found[0] if found else "-"),
        text=line.text,
        voice=case_id.rpartition("-")[0] if line.voice is None else line.voice,
    )
    reference = line.output if line.plan is None else short_plan(line.plan, names)
    if line.refuse is not None or isinstance(reference, Refusal):
        why = reference.reason if isinstance(reference, Refusal) else line.refuse
        return replace(case, refuse=why or "it cannot be done here")
    if reference is not None:
        return reference_case(reference, fleet, names.catalogue, said=case)
    if not line.tasks:
        raise ValueError('it has none of "tasks", "output", "plan" and "refuse"')
    return replace(
        case,
        wanted=tuple(_wanted(t, names.catalogue, fleet) for t in line.tasks),
        before=tuple(line.before),
        unordered=tuple(line.unordered),
    )


def _wanted(task: _Task, catalogue: Catalogue, fleet: Fleet) -> Wanted:
    return Wanted(
        key=task.key,
        verbs=frozenset(verb_of(s, catalogue) for s in task.skill),
        robots=tuple(dict.fromkeys(_spelled_out(r, fleet) for r in task.robots)),
        objects=tuple(tuple(o) for o in task.objects),
        optional=task.optional,
    )


def short_plan(said: str, names: SiteNames) -> Plan | Refusal:
    """Read a plan in the short notation: steps 1, 2, ... between bars, or `refuse REASON`.

    Raises:
        ValueError: a step has not that form, or names what is not there.

    """
    if said.startswith("refuse"):
        return decode(said, names)
    lines: list[str] = []
    for position, step in enumerate(said.split("|"), 1):
        match = _STEP.fullmatch(step.strip())
        if match is None or int(match["number"]) != position:
            raise ValueError(f"step {position} is {step.strip()!r}, not 'number verb robots @ objects < numbers'")
        before = " ".join(label(int(n) - 1) for n in (match["before"] or "").split() if int(n) > 0)
        lines.append(f"{label(position - 1)} {match['act']}" + (f" < {before}" if before else ""))
    return decode("\n".join(lines), names)


def verb_of(skill: str, catalogue: Catalogue) -> str:
    """Return a skill's verb, the same for the whole fleet and for some; an unknown skill comes back as it is."""
    return catalogue[skill].verb if skill in catalogue else skill


def _spelled_out(said: list[str] | Mapping[str, Any], fleet: Fleet) -> tuple[str, ...]:
    if isinstance(said, list):
        return tuple(said)
    if said.get("all"):
        return fleet.everyone
    count: int | Literal["all"] = "all" if said["count"] == "all" else int(said["count"])
    return fleet.of_type(str(said["type"]), count)


def reference_case(plan: Plan, fleet: Fleet, catalogue: Catalogue, *, said: Case) -> Case:
    """Return the case whose one right answer is this plan, said in any of the equal ways.

    What the plan orders, however indirectly, must be ordered; what it leaves unordered must stay so, except for two
    tasks of one robot, which does them one after the other anyway. Where a robot works may be said or not.

    Raises:
        ValueError: two tasks have one name, a dependency is unknown, or they form a cycle.

    """
    named = {t.task: t.instruction_function for t in plan.tasks}
    if len(named) < len(plan.tasks) or not named:
        raise ValueError("the plan has no task, or two of one name")
    above = ancestors({name: f.dependencies for name, f in named.items()})
    verbs = {name: verb_of(f.name, catalogue) for name, f in named.items()}
    robots = {name: fleet.meant_by(f) for name, f in named.items()}
    wanted: list[Wanted] = []
    for name, function in named.items():
        objects: tuple[tuple[str, ...], ...] = (function.object_keywords,)
        optional = function.name in catalogue and catalogue[function.name].objects is ObjectNeed.OPTIONAL
        if optional and function.object_keywords:
            objects = ((), *objects)
        elif optional:
            went = [n for n in named if n in above[name] and verbs[n] == "go" and set(robots[n]) & set(robots[name])]
            last = [n for n in went if not any(n in above[m] for m in went)]
            objects = ((), *((o,) for n in last for o in named[n].object_keywords))
        wanted.append(Wanted(name, frozenset({verbs[name]}), (robots[name],), tuple(dict.fromkeys(objects))))
    before = tuple((b, name) for name, f in named.items() for b in f.dependencies)
    free = [
        (a, b)
        for n, a in enumerate(named)
        for b in list(named)[n + 1 :]
        if a not in above[b] and b not in above[a]
        if {verbs[a], verbs[b]} & RULES or not set(robots[a]) & set(robots[b])
    ]
    joint = frozenset((a, b) for a, b in free if _same_moment(a, b, named, verbs))
    return replace(said, wanted=tuple(wanted), before=before, unordered=tuple(free), may_join=joint, reference=plan)


def _same_moment(a: str, b: str, named: Mapping[str, Any], verbs: Mapping[str, str]) -> bool:
    """Tell whether two tasks do the same thing at the same moment: one joint task is right, too."""
    return verbs[a] == verbs[b] and set(named[a].dependencies) == set(named[b].dependencies)


def ancestors(parents: Mapping[str, Sequence[str] | Iterable[str]]) -> dict[str, frozenset[str]]:
    """Return for each name all that comes before it, however indirectly.

    Raises:
        ValueError: a parent is unknown, or they form a cycle.

    """
    closed: dict[str, frozenset[str]] = {}
    visiting: set[str] = set()

    def visit(name: str) -> frozenset[str]:
        if name in visiting:
            raise ValueError(f"the dependencies of {name!r} form a cycle")
        if name not in closed:
            if name not in parents:
                raise ValueError(f"there is no task {name!r} to wait for")
            visiting.add(name)
            direct = frozenset(parents[name])
            closed[name] = direct.union(*(visit(p) for p in cast("Iterable[str]", direct)))
            visiting.discard(name)
        return closed[name]

    for name in parents:
        visit(name)
    return closed
