"""What is on a site, as the model reads it: words, and the places of the things that a plan can name.

After the instruction the model reads, for each type of robot, its words, its robots' numbers and its verbs; then `all`
with the verbs that every robot has; then the objects:

    excavator 1 2 3 dig dump [SEP] dump truck 1 2 3 load tip [SEP] all avoid go allow home [SEP] puddle 1 soil 1 [SEP]

Each type, robot, verb and object there is an `Item`. The model's answer points at items, so it can name nothing else,
and a robot or object that it has never seen is as good as any other.
"""

import re
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

_PARTS = re.compile(r"[A-Za-z]+|\d+")


class ItemType(IntEnum):
    """What an item is."""

    KIND = 0
    ROBOT = 1
    VERB = 2
    ALL = 3
    OBJECT = 4


@dataclass(frozen=True)
class Item:
    """A thing that an answer can point at; `kind` is the place of its type of robot in the scene, else -1."""

    type: ItemType
    name: str
    """As the plan language says it: `T`, `T2`, `tip`, `all`, `soil1`."""
    words: str
    """As the model reads it."""
    kind: int = -1


@dataclass(frozen=True)
class SceneKind:
    """A type of robot: its words ("dump truck"), its letter, its robots' short names, the verbs that only it has."""

    words: str
    letter: str
    robots: tuple[str, ...]
    verbs: tuple[str, ...]


@dataclass(frozen=True)
class Scene:
    """Robots, verbs and objects of a site; `common` are the verbs of every robot."""

    kinds: tuple[SceneKind, ...]
    common: tuple[str, ...]
    objects: tuple[str, ...]
    placed: frozenset[str] = frozenset({"go", "avoid", "allow"})
    """Verbs that need an object."""
    placeless: frozenset[str] = frozenset({"home"})
    """Verbs that take none."""

    @cached_property
    def groups(self) -> tuple[tuple[Item, ...], ...]:
        """Return the items in the order in which the model reads them, group by group."""
        of_kinds = [
            (
                Item(ItemType.KIND, kind.letter, kind.words, n),
                *(Item(ItemType.ROBOT, r, r.removeprefix(kind.letter), n) for r in kind.robots),
                *(Item(ItemType.VERB, v, v, n) for v in kind.verbs),
            )
            for n, kind in enumerate(self.kinds)
        ]
        fleet = (Item(ItemType.ALL, "all", "all"), *(Item(ItemType.VERB, v, v) for v in self.common))
        things = tuple(Item(ItemType.OBJECT, o, " ".join(_PARTS.findall(o)) or "thing") for o in self.objects)
        return tuple(g for g in (*of_kinds, fleet, things) if g)

    @cached_property
    def items(self) -> tuple[Item, ...]:
        """Return all items."""
        return tuple(i for group in self.groups for i in group)

    @cached_property
    def places(self) -> dict[tuple[str, int], int]:
        """Return (name, kind) -> place in `items`; a common verb, `all` and objects have kind -1."""
        return {(i.name, i.kind): n for n, i in enumerate(self.items)}
