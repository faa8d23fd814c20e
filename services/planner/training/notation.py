"""The corpus notation read into steps, and the order in which the model is taught to say them.

The corpus allows references to later steps ("home E2 < 2 | go E2"). The model is taught the same graph with every step
after those that it waits for (otherwise in the order of the words), and without dependencies that others imply: it
then never has to count steps that it has not said yet, and a cycle cannot be written.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

_STEP = re.compile(r"(\d+) (\w+) ([^@<]+?)(?: @ ([^<]+?))?(?: < ([\d ]+))?$")


@dataclass(frozen=True)
class Step:
    """One step: robots and objects by their short names, `before` the positions (from 0) of what it waits for."""

    verb: str
    robots: tuple[str, ...]
    objects: tuple[str, ...] = ()
    before: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Refusal:
    """The answer to what cannot be planned."""

    reason: str


Answer = tuple[Step, ...] | Refusal


def parse(plan: str) -> Answer:
    """Read a plan in corpus notation ("1 go E1 @ soil1 | 2 dig E1 @ soil1 < 1", or "refuse REASON").

    Raises:
        ValueError: a step does not have that form.

    """
    if plan.startswith("refuse "):
        return Refusal(plan.removeprefix("refuse ").strip())
    steps: list[Step] = []
    for text in plan.split("|"):
        match = _STEP.fullmatch(text.strip())
        if match is None:
            raise ValueError(f"step {text!r}")
        before = frozenset(int(n) - 1 for n in (match[5] or "").split())
        steps.append(Step(match[2], tuple(match[3].split()), tuple((match[4] or "").split()), before))
    return canonical(steps)


def canonical(steps: Sequence[Step]) -> tuple[Step, ...]:
    """Return the same graph in teaching order, dependencies reduced to those that no other implies."""
    order: list[int] = []

    def visit(n: int) -> None:
        if n not in order:
            for b in sorted(steps[n].before):
                visit(b)
            order.append(n)

    for n in range(len(steps)):
        visit(n)
    place = {old: new for new, old in enumerate(order)}
    ancestors: list[frozenset[int]] = []
    result: list[Step] = []
    for old in order:
        before = frozenset(place[b] for b in steps[old].before)
        implied = frozenset[int]().union(*(ancestors[b] for b in before))
        ancestors.append(before | implied)
        robots = tuple(sorted(set(steps[old].robots)))
        result.append(replace(steps[old], robots=robots, before=before - implied))
    return tuple(result)
