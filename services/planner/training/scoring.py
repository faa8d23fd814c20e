"""Whether a plan is right, by the rules of the shared scorer: a measure for the held-out voices.

A plan is right when its (skill, robot, object) atoms are the expected ones, what must come before comes before (over
any number of steps), and what is unordered stays so. The object of dig, dump, load and tip may be left out. One joint
task is the same as one task a robot, with the order that each needs.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from .notation import Step

OPTIONAL_OBJECT = ("dig", "dump", "load", "tip")
_FLEET = {"E": ("E1", "E2", "E3"), "T": ("T1", "T2", "T3")}


@dataclass(frozen=True)
class Atom:
    """One robot's part in one step."""

    verb: str
    robot: str
    object: str | None
    step: int

    def fits(self, other: "Atom") -> bool:
        """Tell whether this predicted atom is the expected `other`, steps aside."""
        if (self.verb, self.robot) != (other.verb, other.robot):
            return False
        return self.object == other.object or (self.verb in OPTIONAL_OBJECT and None in (self.object, other.object))


def robots_of(names: Sequence[str]) -> Iterator[str]:
    """Yield single robots: `all` and `T*` spelled out for the yard, `T:2` as two of unknown number."""
    for name in names:
        if name == "all":
            yield from (*_FLEET["E"], *_FLEET["T"])
        elif name.endswith("*"):
            yield from _FLEET[name[0]]
        elif ":" in name:
            yield from (f"{name[0]}?{i}" for i in range(int(name[2:])))
        else:
            yield name


def atoms_of(steps: Sequence[Step]) -> list[Atom]:
    """Return every robot's part in every step."""
    return [
        Atom(s.verb, r, o, n) for n, s in enumerate(steps) for r in robots_of(s.robots) for o in (s.objects or (None,))
    ]


def ancestors(steps: Sequence[Step]) -> list[set[int]]:
    """Return for each step all the steps that end before it, however indirectly; steps may stand in any order."""
    known: dict[int, set[int]] = {}

    def visit(n: int) -> set[int]:
        if n not in known:
            known[n] = set()
            known[n] = set(steps[n].before).union(*(visit(b) for b in steps[n].before))
        return known[n]

    return [visit(n) for n in range(len(steps))]


def is_right(expected: Sequence[Step], predicted: Sequence[Step]) -> bool:
    """Tell whether the predicted steps mean the same as the expected ones."""
    wanted, found = atoms_of(expected), atoms_of(predicted)
    if len(wanted) != len(found) or Counter((a.verb, a.robot) for a in wanted) != Counter(
        (a.verb, a.robot) for a in found
    ):
        return False
    above_expected, above = ancestors(expected), ancestors(predicted)
    budget = [2000]
    for places in _assignments(wanted, found, {}, budget):
        if _in_order(expected, wanted, above_expected, places, above):
            return True
    return False


def _assignments(
    wanted: Sequence[Atom], found: Sequence[Atom], chosen: dict[int, int], budget: list[int]
) -> Iterator[Mapping[int, int]]:
    """Yield ways to give each expected atom a predicted one of its own: {its position: the predicted step}."""
    at = len(chosen)
    if at == len(wanted):
        yield {n: found[c].step for n, c in chosen.items()}
        return
    tried: set[int] = set()
    for n, atom in enumerate(found):
        if n in chosen.values() or atom.step in tried or not atom.fits(wanted[at]):
            continue
        tried.add(atom.step)
        budget[0] -= 1
        if budget[0] < 0:
            return
        yield from _assignments(wanted, found, {**chosen, at: n}, budget)


def _in_order(
    expected: Sequence[Step],
    wanted: Sequence[Atom],
    above_expected: Sequence[set[int]],
    places: Mapping[int, int],
    above: Sequence[set[int]],
) -> bool:
    found_steps = _steps_of(places, wanted)
    for later, step in enumerate(expected):
        for earlier in step.before:
            if not _held(earlier, later, above_expected, found_steps, above):
                return False
    for one in range(len(expected)):
        for two in range(one):
            if one in above_expected[two] or two in above_expected[one]:
                continue
            pairs = ((x, y) for _, x in found_steps[one] for _, y in found_steps[two])
            if any(x == y or x in above[y] or y in above[x] for x, y in pairs if not _joint(x, y, expected, one, two)):
                return False
    return True


def _joint(x: int, y: int, expected: Sequence[Step], one: int, two: int) -> bool:
    """Tell whether one predicted step serves two expected ones of the same kind, which is no order between them."""
    return x == y and expected[one].verb == expected[two].verb and expected[one].before == expected[two].before


def _steps_of(places: Mapping[int, int], wanted: Sequence[Atom]) -> dict[int, list[tuple[str, int]]]:
    """Return for each expected step the robots and predicted steps that stand for it."""
    result: dict[int, list[tuple[str, int]]] = {}
    for at, atom in enumerate(wanted):
        result.setdefault(atom.step, []).append((atom.robot, places[at]))
    return result


def _held(
    earlier: int,
    later: int,
    above_expected: Sequence[set[int]],
    found: Mapping[int, Sequence[tuple[str, int]]],
    above: Sequence[set[int]],
) -> bool:
    """Tell whether the later step waits for the earlier one, each robot of a joint step as far as it matters."""
    targets = found[later]
    rest = [*targets, *(p for n, a in enumerate(above_expected) if later in a for p in found[n])]
    joint = len({step for _, step in found[earlier]}) == 1
    for robot, step in found[earlier]:
        same = [s for r, s in targets if r == robot]
        must = same or ([s for _, s in targets] if joint else [])
        if must:
            if not all(step in above[s] for s in must):
                return False
        elif not any(step in above[s] for _, s in rest):
            return False
    return True
