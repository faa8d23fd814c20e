"""Composes missions and says them: branches of work first, then how they wait for each other, then the words.

What hand-written cases have too little of: step-level waits between branches in every direction, late and reversed
conditions, corrections, counts and types, and sites with other robots and things, so that the model reads the roster
and the objects in its prompt.
"""

import random
from collections.abc import Sequence
from dataclasses import replace

from .augment import Case
from .branches import BRANCHES
from .notation import Step, canonical
from .refusals import one_thing, refused
from .sites import DUMP_TRUCK, EXCAVATOR, NEW_KINDS, YARD, YARD_OBJECTS, Site
from .waiting import late_wait, numbered, reordered, useful, with_wait
from .wording import Act, Words, capital

_NEW_THINGS = (
    "trench",
    "gate",
    "pond",
    "hut",
    "pipe",
    "ramp",
    "barrier",
    "crater",
    "stack",
    "sand",
    "gravel",
    "puddle",
    "obstacle",
    "rock",
    "soil",
)


def site_of(random_: random.Random) -> Site:
    """Return the yard mostly, or a site with other robots, other things or other types."""
    if random_.random() < 0.72:
        return YARD
    kinds = [
        replace(k, numbers=tuple(sorted(random_.sample(range(1, 8), random_.randint(1, 4)))))
        for k in (EXCAVATOR, DUMP_TRUCK)
    ]
    if random_.random() < 0.45:
        kinds += random_.sample(NEW_KINDS, random_.randint(1, 2))
        random_.shuffle(kinds)
    objects = list(YARD_OBJECTS)
    if random_.random() < 0.6:
        names = random_.sample(_NEW_THINGS, random_.randint(2, 5))
        objects = [f"{n}{i}" for n in names for i in range(1, random_.randint(1, 3) + 1)]
    return Site(tuple(kinds), tuple(objects))


def mission(random_: random.Random) -> Case:
    """Return one case: a mission, or about once in nine something to refuse."""
    site = site_of(random_)
    words = Words(site, random_)
    chance = random_.random()
    if chance < 0.11:
        return Case(*refused(words, random_), site, "L2")
    if chance < 0.20:
        return Case(*one_thing(words, random_, absent=False), site, "L1")
    for _ in range(20):
        case = _composed(words, site, random_)
        if case is not None:
            return case
    return Case("Everybody home.", (Step("home", ("all",)),), site)


def _composed(words: Words, site: Site, random_: random.Random) -> Case | None:
    words.fresh()
    made = (random_.choice(BRANCHES)(words, random_) for _ in range(random_.choice((1, 2, 2, 3, 3, 3, 4))))
    branches = [b for b in made if b is not None]
    acts, starts = numbered(branches)
    if not branches or len(acts) > 13:
        return None
    waits = _waits(acts, starts, random_)
    steps = _waiting_steps(acts, starts, waits)
    sentences = [
        (n, with_wait(b.text, [acts[w].done for w in waits.get(n, [])], random_, follows=n > 0))
        for n, b in enumerate(branches)
    ]
    extra = late_wait(acts, steps, starts, waits, random_)
    if len(sentences) > 1 and random_.random() < 0.25:
        random_.shuffle(sentences)
        steps = reordered(steps, [*starts, len(acts)], [n for n, _ in sentences])
    text = _assembled([t for _, t in sentences], random_, parallel=not waits)
    if extra:
        text = f"{extra} {text}" if random_.random() < 0.3 else f"{text} {extra}"
    if random_.random() < 0.3:
        text = f"{words.pick(_OPENERS)} {text}"
    if random_.random() < 0.15:
        text = f"{text} {words.pick(_CLOSERS)}"
    return Case(text, canonical(steps), site, "L3" if len(acts) > 4 else "L2" if len(acts) > 2 else "L1")


def _waits(acts: Sequence[Act], starts: Sequence[int], random_: random.Random) -> dict[int, list[int]]:
    """Draw for some branches the earlier acts that they wait for."""
    waits: dict[int, list[int]] = {}
    for later in range(1, len(starts)):
        if random_.random() < 0.6:
            count = min(starts[later], random_.choice((1, 1, 1, 2, 2, 3)))
            waits[later] = useful(acts, random_.sample(range(starts[later]), count))
    return waits


def _waiting_steps(acts: Sequence[Act], starts: Sequence[int], waits: dict[int, list[int]]) -> list[Step]:
    """Return the steps, the first ones of each branch waiting for what the branch waits for."""
    steps = [a.step for a in acts]
    for n, waited in waits.items():
        end = starts[n + 1] if n + 1 < len(starts) else len(acts)
        for i in range(starts[n], end):
            if not any(b >= starts[n] for b in steps[i].before):
                steps[i] = replace(steps[i], before=steps[i].before | frozenset(waited))
    return steps


def _assembled(texts: list[str], random_: random.Random, *, parallel: bool) -> str:
    style = random_.random()
    if len(texts) > 1 and style < 0.1:
        mark = random_.choice(("{}) ", "{}. ", "({}) ", "- ", "* "))
        head = random_.choice(("", "Jobs, all independent unless I say so:\n", "List:\n"))
        return (
            head + "\n".join(mark.format(i) + capital(t) for i, t in enumerate(texts, 1))
            if parallel
            else "\n".join("- " + capital(t) for t in texts)
        )
    if len(texts) > 1 and parallel and style < 0.3:
        return capital(
            "; ".join(texts[:-1]) + random_.choice(("; ", ", and ", ", while ", "; meanwhile ")) + texts[-1] + "."
        )
    return " ".join(capital(t) + random_.choice((".", ".", ".", "!")) for t in texts)


_OPENERS = (
    "Morning all.",
    "Right then.",
    "OK team,",
    "Control here.",
    "Listen up.",
    "Hi,",
    "New plan.",
    "Attention please:",
    "For today:",
    "Next job.",
    "Dear dispatcher,",
    "So,",
    "Heads up:",
    "Good evening.",
    "Site office:",
    "Change of plan.",
    "Hello again,",
    "To everyone on channel 4:",
    "Here is what I need.",
    "Work order:",
    "Gents,",
)
_CLOSERS = (
    "Thanks.",
    "Over.",
    "Cheers.",
    "That's all.",
    "Ta.",
    "Confirm please.",
    "Over and out.",
    "Thank you very much.",
    "Quick as you can.",
    "Mind the mud.",
    "Kind regards, the foreman.",
    "No rush.",
)
