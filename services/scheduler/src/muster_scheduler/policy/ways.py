"""How far it is from place to place."""

from collections.abc import Sequence
from dataclasses import dataclass

from muster_schemas.robot import RobotCard
import math

DETOUR = 1.15


@dataclass(frozen=True, slots=True)
class Place:
    """A spot, or a round object that robots stand around."""

    x: float
    y: float
    radius_m: float = 0.0


class Ways:
    def metres(self, card: RobotCard, starts: Sequence[Place], goal: Place) -> list[float]:
        """Return how far it is from each start."""
        return [DETOUR * max(math.hypot(s.x - goal.x, s.y - goal.y) - s.radius_m - goal.radius_m, 0.0) for s in starts]
