"""Makes new training cases out of hand-written ones without changing what they mean.

Robots and objects change places, numbers and names are said in other ways, two independent instructions become one,
a robot or object that is named is taken from the site (then the answer is a refusal), and the text gets the noise of
people in a hurry.
"""

import random
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from . import mentions
from .noise import noisy
from .notation import Answer, Refusal, Step, canonical
from .sites import YARD, Kind, Site


@dataclass(frozen=True)
class Case:
    """An instruction on a site and its answer."""

    text: str
    answer: Answer
    site: Site = YARD
    level: str = "L1"


RELATIVE = re.compile(
    r"\b(rest|others?|except|bar|but|three|all|both|every\w*|each|whole|fleet|nobody|anybody|anyone|no ?one|only|"
    r"everything|first|last|remaining|same|two|pair|team|crew|any|none|before|nothing|machines?|y'all|robots?)\b",
    re.IGNORECASE,
)
_SAYS = {
    "E": (
        "excavator {}",
        "digger {}",
        "exc {}",
        "EX{}",
        "E{}",
        "EX-{}",
        "excavator no. {}",
        "digger number {}",
        "ex {}",
    ),
    "T": (
        "truck {}",
        "dump truck {}",
        "T{}",
        "DT{}",
        "truck no. {}",
        "tipper {}",
        "dumper {}",
        "hauler {}",
        "truck number {}",
    ),
    "puddle": ("puddle {}", "puddle no. {}", "puddle{}", "puddle number {}"),
    "obstacle": ("obstacle {}", "obstacle no. {}", "obstacle{}", "obst. {}"),
    "soil": ("soil {}", "soil pile {}", "pile {}", "soil{}", "heap {}", "soil pile no. {}"),
    "rock": ("rock {}", "rock{}"),
}
_MENTION = re.compile(
    r"\b(?:(?P<E>(?:excavator|digger) (?:no\. |number )?)|(?P<T>(?:dump truck|truck|tipper|dumper|hauler) "
    r"(?:no\. |number )?)|(?P<puddle>puddle )|(?P<obstacle>obstacle )|(?P<soil>soil pile |soil |pile ))"
    r"(?P<n>\d)(?![\d:.]\d|\d)(?!,? (?:and|or|&) \d)(?!, \d)"
)


def objects_of(steps: Sequence[Step]) -> set[str]:
    """Return the objects that the steps name."""
    return {o for s in steps for o in s.objects}


def named_robots(steps: Sequence[Step]) -> set[str] | None:
    """Return the robots that the steps name one by one; None if a step says "all", "E*" or "T:2"."""
    robots = {r for s in steps for r in s.robots}
    return robots if all(r[1:].isdigit() for r in robots) else None


def substitute(steps: Sequence[Step], names: dict[str, str]) -> tuple[Step, ...]:
    """Return the steps with robots and objects renamed."""
    return canonical(
        [
            replace(
                s, robots=tuple(names.get(r, r) for r in s.robots), objects=tuple(names.get(o, o) for o in s.objects)
            )
            for s in steps
        ]
    )


def permuted(case: Case, random_: random.Random, robots: dict[str, Sequence[int]] | None = None) -> Case | None:
    """Return the case with robots and objects in other places; None where its text is not fully understood.

    `robots` gives for a type's letter the numbers that 1, 2, 3 become (by chance if left out).
    """
    found = mentions.find(case.text)
    if found is None or isinstance(case.answer, Refusal):
        return None
    said = {(m.kind, m.value) for m in found}
    numbers: dict[tuple[str, int], int] = {}
    names: dict[str, str] = {}
    for kind in "ET":
        chosen = (robots or {}).get(kind) or random_.sample((1, 2, 3), 3)
        numbers |= {(kind, i): n for i, n in enumerate(chosen, 1)}
        names |= {f"{kind}{i}": f"{kind}{n}" for i, n in enumerate(chosen, 1)}
    for kind in ("puddle", "obstacle", "soil"):
        used = {(kind, int(o[-1])) for o in objects_of(case.answer) if o.startswith(kind)}
        if used <= said and random_.random() < 0.5:
            numbers |= {(kind, 1): 2, (kind, 2): 1}
            names |= {f"{kind}1": f"{kind}2", f"{kind}2": f"{kind}1"}
    text = mentions.rewrite(case.text, found, numbers)
    return replace(case, text=text, answer=substitute(case.answer, names))


def respoken(text: str, random_: random.Random) -> str:
    """Return the text with some names said in another way ("truck 2" -> "DT2"); one way a kind, mostly."""
    way = {k: random_.choice(v) for k, v in _SAYS.items()}
    often = random_.choice((0.3, 1.0))

    def say(match: re.Match[str]) -> str:
        kind = match.lastgroup if match.lastgroup != "n" else next(k for k in _SAYS if match.groupdict().get(k))
        if random_.random() > often or kind is None:
            return match[0]
        new = way[kind].format(match["n"])
        return new[0].upper() + new[1:] if match[0][0].isupper() else new

    return _MENTION.sub(say, text)


def without_one(case: Case, random_: random.Random) -> Case | None:
    """Return the case on a site that lacks a robot or object which it names: a refusal."""
    found = mentions.find(case.text)
    if not found or isinstance(case.answer, Refusal):
        return None
    steps, robots = case.answer, named_robots(case.answer)
    said = {f"{m.kind}{m.value}" for m in found}
    gone = sorted(said & (objects_of(steps) | (robots or set())))
    if not gone or (robots is None and gone[0][0].isupper()):
        return None
    name = random_.choice(gone)
    if name[0].isupper():
        kind = next(k for k in case.site.kinds if k.letter == name[0])
        site = case.site.renumbered({kind.letter: tuple(n for n in kind.numbers if n != int(name[1:]))})
        word = "truck" if kind.letter == "T" else kind.words
        return replace(case, site=site, answer=Refusal(f"there is no {word} {name[1:]} here"))
    site = replace(case.site, objects=tuple(o for o in case.site.objects if o != name))
    return replace(case, site=site, answer=Refusal(f"there is no {name[:-1]} {name[-1]} here"))


_OTHERS = (
    Kind("bulldozer", "B", (1, 2), ("push",)),
    Kind("roller", "R", (1, 2), ("compact",)),
    Kind("crane", "C", (1,), ("lift", "lower")),
    Kind("wheel loader", "L", (1, 2, 3), ("scoop",)),
    Kind("water truck", "W", (1,), ("spray",)),
    Kind("grader", "G", (1, 2), ("grade",)),
)
_THINGS = ("trench1", "gate1", "pond1", "hut1", "pipe1", "pipe2", "obstacle3", "puddle3", "soil3", "rock2", "ramp1")


def elsewhere(case: Case, random_: random.Random) -> Case:
    """Return the case on a site that has more or fewer robots and things than the yard, where that changes nothing."""
    if isinstance(case.answer, Refusal):
        return case
    site = case.site
    robots, steps = named_robots(case.answer), case.answer
    if robots is not None and not RELATIVE.search(case.text):
        numbers = {
            k.letter: tuple(
                sorted(
                    {int(r[1:]) for r in robots if r[0] == k.letter}
                    | set(random_.sample(range(1, 7), random_.randint(1, 4)))
                )
            )
            for k in site.kinds
        }
        site = site.renumbered(numbers)
    if random_.random() < 0.5:
        extra = random_.sample(_OTHERS, random_.randint(1, 2))
        site = replace(site, kinds=tuple(random_.sample([*site.kinds, *extra], len(site.kinds) + len(extra))))
    keep = objects_of(steps)
    objects = [o for o in site.objects if o in keep or random_.random() < 0.7]
    objects += [t for t in random_.sample(_THINGS, random_.randint(0, 3)) if t not in objects]
    random_.shuffle(objects)
    return replace(case, site=replace(site, objects=tuple(objects or ("rock1",))))


def varied(case: Case, random_: random.Random, plain: float = 0.25) -> Case:
    """Return the case as it is (`plain` of the time), or changed in a few of the ways above."""
    if random_.random() < plain:
        return case
    if random_.random() < 0.04 and (gone := without_one(case, random_)):
        return gone
    if random_.random() < 0.75:
        case = permuted(case, random_) or case
    if random_.random() < 0.12:
        case = elsewhere(case, random_)
    if random_.random() < 0.35:
        case = replace(case, text=respoken(case.text, random_))
    return replace(case, text=noisy(case.text, random_))
