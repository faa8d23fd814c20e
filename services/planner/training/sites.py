"""Sites to train on: which robots and objects an instruction meets, and the prompt that tells the model of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

COMMON = ("avoid", "go", "allow", "home")


@dataclass(frozen=True)
class Kind:
    """A type of robot: its words ("dump truck"), its letter, its robots' numbers, the verbs that only it can do."""

    words: str
    letter: str
    numbers: tuple[int, ...]
    verbs: tuple[str, ...]


EXCAVATOR = Kind("excavator", "E", (1, 2, 3), ("dig", "dump"))
DUMP_TRUCK = Kind("dump truck", "T", (1, 2, 3), ("load", "tip"))
YARD_OBJECTS = ("obstacle1", "obstacle2", "puddle1", "puddle2", "rock1", "soil1", "soil2")


NEW_KINDS = (
    Kind("bulldozer", "B", (1, 2), ("push",)),
    Kind("roller", "R", (1, 2), ("compact",)),
    Kind("crane", "C", (1, 2), ("lift", "lower")),
    Kind("wheel loader", "L", (1, 2), ("scoop",)),
    Kind("water truck", "W", (1,), ("spray",)),
    Kind("grader", "G", (1, 2, 3), ("level",)),
    Kind("forklift", "F", (1, 2), ("lift",)),
    Kind("drone", "D", (1, 2), ("scan",)),
)
"""Types that the yard lacks, with verbs of their own."""


@dataclass(frozen=True)
class Site:
    """What the prompt says: the types with their robots, and the objects."""

    kinds: tuple[Kind, ...] = (EXCAVATOR, DUMP_TRUCK)
    objects: tuple[str, ...] = YARD_OBJECTS
    common: tuple[str, ...] = field(default=COMMON)

    def renumbered(self, numbers: Mapping[str, tuple[int, ...]]) -> "Site":
        """Return the site with other robots: letter -> numbers; a type that is left without robots goes."""
        kinds = (replace(k, numbers=numbers.get(k.letter, k.numbers)) for k in self.kinds)
        return replace(self, kinds=tuple(k for k in kinds if k.numbers))


YARD = Site()
"""The default site; most cases are about it."""
