"""How far it is from place to place."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

DETOUR: Final = 1.15
"""A real way over the straight line, on a site with a few things in between."""


@dataclass(frozen=True, slots=True)
class Place:
    """A spot, or a round object that robots stand around. Metres."""

    x: float
    y: float
    radius_m: float = 0.0


def metres(starts: Sequence[Place], goal: Place) -> list[float]:
    """Return how far it is from the edge of each start to the edge of the goal."""
    gaps = (math.hypot(s.x - goal.x, s.y - goal.y) - s.radius_m - goal.radius_m for s in starts)
    return [DETOUR * max(gap, 0.0) for gap in gaps]
