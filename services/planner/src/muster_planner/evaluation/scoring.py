"""Whether a plan is the right one for a case, and how far from it: SR, IPA, DSR and SGSR of one answer.

A plan is right when its atoms (skill, robot, object) are exactly the wanted ones, every `before` pair is ordered in the
transitive closure of its dependencies, and no `unordered` pair is. Naming the whole fleet, or every robot of a type,
is the same as listing the ids; one joint task is the same as one task a robot, with the order that each needs. The
definitions are in docs/evaluation.md.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from muster_schemas.plan import Plan
from muster_schemas.skills import Catalogue

from .cases import Case, Wanted, ancestors, verb_of
from .fleet import Fleet

_ASSIGNMENTS = 20_000
"""Steps of the search among the ways in which planned atoms may stand for wanted ones."""

_SHOWN = 6


@dataclass(frozen=True)
class Score:
    """How right one answer is; each measure from 0 to 1."""

    sr: float = 0.0
    ipa: float = 0.0
    dsr: float = 0.0
    sgsr: float = 0.0
    why: str = ""
    """What is wrong in some words; empty if nothing is."""
    diff: tuple[str, ...] = ()
    """`- wanted and not planned`, `+ planned and not wanted`, `~ order that is wrong`."""

    @property
    def right(self) -> bool:
        """Whether the answer is right as a whole."""
        return self.sr == 1.0


@dataclass(frozen=True)
class _Atom:
    """One robot's part in one task, at one object."""

    verb: str
    robot: str
    object: str | None
    task: str

    def __str__(self) -> str:
        return f"{self.verb} {self.robot}" + (f" @ {self.object}" if self.object else "")


@dataclass(frozen=True)
class _WantedAtom:
    verbs: frozenset[str]
    robot: str
    objects: frozenset[str | None]

    def fits(self, atom: _Atom) -> bool:
        return atom.verb in self.verbs and atom.robot == self.robot and atom.object in self.objects

    def __str__(self) -> str:
        places = " or ".join(sorted(o for o in self.objects if o))
        return f"{'/'.join(sorted(self.verbs))} {self.robot}" + (f" @ {places}" if places else "")


_Choice = Mapping[str, Sequence[_WantedAtom]]
"""One way to read a case: the atoms of each wanted task."""

_Places = Mapping[tuple[str, int], str]
"""Which planned task stands for atom number n of the wanted task with that key."""


def score(case: Case, plan: Plan | None, fleet: Fleet, catalogue: Catalogue) -> Score:
    """Return the score of a plan for a case that has one; no plan scores 0 in everything."""
    if plan is None:
        return Score(why="no plan")
    try:
        found = _atoms(plan, fleet, catalogue)
        above = ancestors({t.task: t.instruction_function.dependencies for t in plan.tasks})
    except ValueError as error:
        return Score(why=f"no valid plan: {error}")
    choices = list(_choices(case))
    best: tuple[tuple[bool, int, int], Score] | None = None
    for choice in choices:
        total = sum(len(atoms) for atoms in choice.values())
        for places in _assignments(case, choice, found):
            wrong, asked = _order(case, choice, places, above)
            extra = _unplaced(found, choice, places)
            if not extra and not wrong:
                return Score(1.0, 1.0, 1.0, 1.0)
            rank = (not wrong, -len(extra), -len(wrong))
            if best is None or rank > best[0]:
                held = (asked - len(wrong)) / asked if asked else 1.0
                best = (
                    rank,
                    Score(
                        ipa=total / (total + len(extra)),
                        dsr=held,
                        sgsr=1.0,
                        why=", ".join(
                            [*([f"{len(extra)} too many"] if extra else []), *([f"order {held:.0%}"] if wrong else [])]
                        ),
                        diff=_cut([f"+ {atom}" for atom in extra] + [f"~ {line}" for line in wrong]),
                    ),
                )
    return best[1] if best else _partly(choices, found)


def _atoms(plan: Plan, fleet: Fleet, catalogue: Catalogue) -> list[_Atom]:
    names = [t.task for t in plan.tasks]
    if len(set(names)) < len(names):
        raise ValueError("two tasks have one name")
    return [
        _Atom(verb_of(t.instruction_function.name, catalogue), robot, place, t.task)
        for t in plan.tasks
        for robot in fleet.meant_by(t.instruction_function)
        for place in t.instruction_function.object_keywords or (None,)
    ]


def _choices(case: Case) -> Iterator[_Choice]:
    """Yield every choice among the alternatives that a case allows."""
    keys = [w.key for w in case.wanted]
    for combination in itertools.product(*(_ways(w) for w in case.wanted)):
        yield dict(zip(keys, combination, strict=True))


def _ways(wanted: Wanted) -> list[list[_WantedAtom]]:
    """Return the ways to do one task: at most one object each (any of those allowed), or several objects together."""
    single = frozenset[str | None](o[0] if o else None for o in wanted.objects if len(o) <= 1)
    several = [o for o in wanted.objects if len(o) > 1]
    ways: list[list[_WantedAtom]] = []
    for robots in wanted.robots:
        if single:
            ways.append([_WantedAtom(wanted.verbs, r, single) for r in robots])
        ways += [[_WantedAtom(wanted.verbs, r, frozenset({o})) for r in robots for o in named] for named in several]
    return [way for n, way in enumerate(ways) if way not in ways[:n]]


def _assignments(case: Case, choice: _Choice, found: Sequence[_Atom]) -> Iterator[_Places]:
    """Yield ways to give each wanted atom a planned one of its own; atoms of optional tasks may go without."""
    optional = {w.key for w in case.wanted if w.optional}
    wanted = [(key, n, atom) for key, atoms in choice.items() for n, atom in enumerate(atoms)]
    wanted.sort(key=lambda w: sum(w[2].fits(atom) for atom in found))  # those with the fewest ways first
    steps = itertools.count()

    def go(at: int, used: frozenset[int], places: dict[tuple[str, int], str]) -> Iterator[_Places]:
        if next(steps) > _ASSIGNMENTS:
            return
        if at == len(wanted):
            yield dict(places)
            return
        key, n, atom = wanted[at]
        tried: set[str] = set()
        for number, candidate in enumerate(found):
            if number not in used and candidate.task not in tried and atom.fits(candidate):
                tried.add(candidate.task)
                yield from go(at + 1, used | {number}, {**places, (key, n): candidate.task})
        if key in optional:
            yield from go(at + 1, used, places)

    yield from go(0, frozenset(), {})


def _unplaced(found: Sequence[_Atom], choice: _Choice, places: _Places) -> list[_Atom]:
    """Return the planned atoms that stand for no wanted one."""
    free = list(found)
    for (key, n), task in places.items():
        free.remove(next(a for a in free if a.task == task and choice[key][n].fits(a)))
    return free


def _order(case: Case, choice: _Choice, places: _Places, above: Mapping[str, frozenset[str]]) -> tuple[list[str], int]:
    """Return what is wrong with the order, and how many pairs were asked for."""
    parts = {
        key: [(atom.robot, places[key, n]) for n, atom in enumerate(atoms) if (key, n) in places]
        for key, atoms in choice.items()
    }
    said = {key: str(atoms[0]) + (" ..." if len(atoms) > 1 else "") for key, atoms in choice.items() if atoms}
    later = _later(case)
    wrong = [
        f"{said[b]} must wait for {said[a]}"
        for a, b in case.before
        if not _waits(parts[a], parts[b], [p for key in later[b] for p in parts[key]], above)
    ]
    for a, b in case.unordered:
        joint = (a, b) in case.may_join
        pairs = ((x, y) for _, x in parts[a] for _, y in parts[b])
        if any(x in above[y] or y in above[x] or (x == y and not joint) for x, y in pairs):
            wrong.append(f"{said[a]} and {said[b]} must not wait for each other")
    return wrong, len(case.before) + len(case.unordered)


def _waits(
    earlier: Sequence[tuple[str, str]],
    targets: Sequence[tuple[str, str]],
    further: Sequence[tuple[str, str]],
    above: Mapping[str, frozenset[str]],
) -> bool:
    """Tell whether one wanted task waits for another, each robot of a joint one as far as it matters to it.

    A robot that does both must have done the first; so must all, if the first is one task. A robot that does only the
    first must be waited for by the second or by something after it.
    """
    one_task = len({task for _, task in earlier}) == 1
    for robot, task in earlier:
        must = [t for r, t in targets if r == robot] or ([t for _, t in targets] if one_task else [])
        if must:
            if not all(task in above[t] for t in must):
                return False
        elif (targets or further) and not any(task in above[t] for _, t in (*targets, *further)):
            return False
    return True


def _later(case: Case) -> dict[str, frozenset[str]]:
    """Return for each key the keys of what comes after it, however indirectly (cycles in a case do no harm)."""
    after: dict[str, set[str]] = {w.key: set() for w in case.wanted}
    for a, b in case.before:
        after[a].add(b)

    def reach(key: str, seen: set[str]) -> set[str]:
        for following in after[key] - seen:
            seen.add(following)
            reach(following, seen)
        return seen

    return {key: frozenset(reach(key, set())) for key in after}


def _partly(choices: Sequence[_Choice], found: Sequence[_Atom]) -> Score:
    """Return the score of a plan that lacks a wanted atom: the share that is there, in the kindest reading."""
    best = -1.0
    diff: tuple[str, ...] = ()
    for choice in choices:
        wanted = [atom for atoms in choice.values() for atom in atoms]
        free, missing = list(found), list[_WantedAtom]()
        for atom in wanted:
            match = next((a for a in free if atom.fits(a)), None)
            if match:
                free.remove(match)
            else:
                missing.append(atom)
        share = (len(wanted) - len(missing)) / max(len(wanted), len(found), 1)
        if share > best:
            best, diff = share, _cut([f"- {a}" for a in missing] + [f"+ {a}" for a in free])
    return Score(ipa=best, sgsr=1.0, why=f"steps differ ({best:.0%} right)", diff=diff)


def _cut(lines: Sequence[str]) -> tuple[str, ...]:
    return tuple(lines[:_SHOWN]) + ((f"... and {len(lines) - _SHOWN} more",) if len(lines) > _SHOWN else ())
