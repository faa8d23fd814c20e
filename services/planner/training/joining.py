"""Makes one long instruction of two short independent ones."""

import random
from collections.abc import Sequence
from dataclasses import replace

from . import mentions
from .augment import RELATIVE, Case, named_robots, objects_of, permuted
from .notation import Refusal, canonical

_BESIDE = (
    ". Meanwhile, {}",
    ". {}",
    "\n{}",
    ". At the same time: {}",
    ". Independently of that, {}",
    "\n\n{}",
    "; in parallel, {}",
    ". In the meantime {}",
    ". Separate job: {}",
    ". Other matter. {}",
    " / {}",
)
_AFTER = (
    ". Once all that's done: {}",
    ". When that's finished, {}",
    ". Only after all of that: {}",
    ". Then {}",
    ". After that, {}",
    ", and when all this is done, {}",
    "\nNext, when the above is complete: {}",
)


def joined(one: Case, two: Case, random_: random.Random) -> Case | None:
    """Return both instructions as one, beside or after each other, with robots of their own; None if they cannot be."""
    robots = _robots_apart(one, two, random_)
    if robots is None:
        return None
    first, second = (permuted(c, random_, r) for c, r in zip((one, two), robots, strict=True))
    if first is None or second is None or isinstance(first.answer, Refusal) or isinstance(second.answer, Refusal):
        return None
    shift = len(first.answer)
    later = random_.random() < 0.35
    sinks = frozenset(range(shift)) - frozenset[int]().union(*(s.before for s in first.answer))
    tail = [
        replace(s, before=frozenset(b + shift for b in s.before) | (sinks if later and not s.before else frozenset()))
        for s in second.answer
    ]
    text = _text(first.text.strip(), second.text.strip(), random_.choice(_AFTER if later else _BESIDE), random_)
    return Case(text, canonical([*first.answer, *tail]), one.site, "L3")


def _robots_apart(one: Case, two: Case, random_: random.Random) -> list[dict[str, Sequence[int]]] | None:
    """Draw numbers for both instructions' robots so that they share none; None if the two do not go together.

    For each instruction: letter -> what 1, 2, 3 become.
    """
    if isinstance(one.answer, Refusal) or isinstance(two.answer, Refusal):
        return None
    groups = [named_robots(one.answer), named_robots(two.answer)]
    if None in groups or len(one.answer) + len(two.answer) > 13:
        return None
    if any(RELATIVE.search(c.text) for c in (one, two)) or _points_back(one, two):
        return None
    spread: list[dict[str, Sequence[int]]] = [{}, {}]
    for kind in "ET":
        counts = [sorted(int(r[1:]) for r in g or () if r[0] == kind) for g in groups]
        if len(counts[0]) + len(counts[1]) > 3:
            return None
        deck = random_.sample((1, 2, 3), 3)
        for side, used in enumerate(counts):
            mine = [deck.pop() for _ in used]
            rest = [n for n in (1, 2, 3) if n not in mine]
            spread[side][kind] = [mine[used.index(i)] if i in used else rest.pop() for i in (1, 2, 3)]
    return spread


def _text(first: str, second: str, join: str, random_: random.Random) -> str:
    """Return both texts with `join` between; a start in the middle of a sentence mostly loses its capital."""
    starts_sentence = join[join.index("{") - 2] not in ",.ens"
    if not starts_sentence and second[:2] != second[:2].upper() and random_.random() < 0.8:
        second = second[0].lower() + second[1:]
    return (first if join.startswith("\n") else first.rstrip(".!")) + join.format(second)


def _points_back(one: Case, two: Case) -> bool:
    """Tell whether "the puddle" (number 1) in the second would be read as the puddle that the first names."""
    numbered = {f"{m.kind}{m.value}" for m in mentions.find(two.text) or []}
    answers = [set[str]() if isinstance(c.answer, Refusal) else objects_of(c.answer) for c in (one, two)]
    bare = {o[:-1] for o in answers[1] - numbered}
    return any(o[:-1] in bare and o not in answers[1] for o in answers[0])
