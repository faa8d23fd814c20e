"""A second look at the likeliest answers, which asks whether they use what the instruction names and say nothing twice.

The search knows only probabilities. Numbers are the part of language that a program reads reliably, so an answer that
leaves out a robot or thing which the text names by number must be much likelier than one that leaves out nothing.
"""

from collections.abc import Sequence
from itertools import pairwise

from .mentions import corrects_itself, numbers_of
from .pointer.choices import Line, Writing
from .pointer.scene import ItemType
from .pointer.search import Found
from .short_names import SiteNames

LEFT_OUT = 3.0
"""What a robot or thing left out costs, as a logarithm of probability."""
TWICE = 2.0
"""What a line that says the same as the one before costs."""


def ranked(found: Sequence[Found], text: str, names: SiteNames) -> list[Found]:
    """Return the answers, the best first."""
    named = set[str]() if corrects_itself(text) else _named(text, names)
    return sorted(found, key=lambda f: _cost(f.writing, named) - f.score)


def _cost(writing: Writing, named: set[str]) -> float:
    if writing.refusal:
        return 0.0
    bodies = [(line.verb, line.robots, line.count, line.objects) for line in writing.lines]
    twice = sum(a == b for a, b in pairwise(bodies))
    used = set[str]().union(*(_used(line, writing) for line in writing.lines))
    return LEFT_OUT * len(named - used) + TWICE * twice


def _used(line: Line, writing: Writing) -> set[str]:
    """Return the robots and things that a line is about; a type or `all` is about all of its robots."""
    scene = writing.scene
    used = {scene.items[o].name for o in line.objects}
    for place in line.robots:
        item = scene.items[place]
        if item.type is ItemType.ROBOT:
            used.add(item.name)
        else:
            used |= {r for n, k in enumerate(scene.kinds) for r in k.robots if item.kind in (-1, n)}
    return used


def _named(text: str, names: SiteNames) -> set[str]:
    """Return the robots and things of the site that the text names by number."""
    classes = {o.rstrip("0123456789") for o in names.objects}
    things = {f"{kind}{n}" for kind, n in numbers_of(text, sorted(classes - {""}), robots=False)}
    types = {k.type: k.letter for k in names.kinds}
    robots = {f"{types[kind]}{n}" for kind, n in numbers_of(text, sorted(types), robots=True)}
    return (things & set(names.objects)) | (robots & set(names.robot_ids))
