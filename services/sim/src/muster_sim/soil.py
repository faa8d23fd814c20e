"""Where the soil is: heaps that grow and shrink, and what was dug out of the level ground. Pure bookkeeping."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

from muster_schemas.base import Point
from muster_schemas.sim import SoilDeposit

from .snapshot import HeapState

SLOPE: Final = 0.6
"""Height over radius of soil that was dropped."""
LEAST_M3: Final = 1e-6
"""A heap with less than this is gone."""


def mound_volume(radius_m: float, height_m: float) -> float:
    """Return the volume in m3 of a heap with the profile h (1 - (d/r)^2)."""
    return math.pi * radius_m**2 * height_m / 2


@dataclass
class Heap:
    """Soil on the ground. Its shape keeps its proportions while its size follows the amount."""

    number: int
    x: float
    y: float
    soil_m3: float
    slope: float = SLOPE
    fill: float = 1.0
    """Volume over that of the ideal profile, for a pile whose file gives all three of radius, height and amount."""
    pile: str | None = None

    @property
    def radius_m(self) -> float:
        """Radius on the ground."""
        return (2 * self.soil_m3 / (math.pi * self.slope * self.fill)) ** (1 / 3)

    @property
    def height_m(self) -> float:
        """Height in the middle."""
        return self.slope * self.radius_m

    def height_at(self, x: float, y: float) -> float:
        """Return how high the soil stands at a place, 0 beside the heap."""
        share = math.hypot(x - self.x, y - self.y) / max(self.radius_m, 1e-9)
        return self.height_m * max(0.0, 1 - share**2)


@dataclass
class Ground:
    """All soil that lies on the site. What robots carry is not in here."""

    heaps: dict[int, Heap] = field(default_factory=dict[int, Heap])
    dug_m3: float = 0.0
    """Taken out of the level ground since the start."""
    _next: int = 0

    def __iter__(self) -> Iterator[Heap]:
        return iter(self.heaps.values())

    @property
    def heaped_m3(self) -> float:
        """All soil in heaps."""
        return math.fsum(h.soil_m3 for h in self)

    def add_pile(self, name: str, at: Point, radius_m: float, height_m: float, soil_m3: float) -> Heap:
        """Put one of the site's soil piles on the ground; without an amount or height, its size tells them."""
        height_m = height_m or SLOPE * radius_m
        ideal = mound_volume(radius_m, height_m)
        soil_m3 = soil_m3 or ideal
        return self._add(Heap(self._next, at.x, at.y, soil_m3, height_m / radius_m, soil_m3 / ideal, name))

    def drop(self, x: float, y: float, soil_m3: float) -> Heap:
        """Let soil fall; it joins the nearest heap whose edge it falls within, else it makes a heap of its own."""
        reached = [h for h in self if math.hypot(x - h.x, y - h.y) <= h.radius_m]
        if not reached:
            return self._add(Heap(self._next, x, y, soil_m3))
        heap = min(reached, key=lambda h: math.hypot(x - h.x, y - h.y))
        heap.soil_m3 += soil_m3
        return heap

    def surface_m(self, x: float, y: float) -> float:
        """Return the height of the soil's surface; 0 on level ground."""
        return max((h.height_at(x, y) for h in self), default=0.0)

    def take(self, x: float, y: float, most_m3: float) -> float:
        """Dig up to `most_m3` at a place and return what there was: a heap's soil, else the ground itself."""
        heap = max(self, key=lambda h: h.height_at(x, y), default=None)
        if heap is None or heap.height_at(x, y) <= 0:
            self.dug_m3 += most_m3
            return most_m3
        taken = min(most_m3, heap.soil_m3)
        heap.soil_m3 -= taken
        if heap.soil_m3 < LEAST_M3:
            taken += heap.soil_m3
            del self.heaps[heap.number]
        return taken

    def deposits(self) -> tuple[SoilDeposit, ...]:
        """Return the truth about the heaps, for the bus."""
        return tuple(SoilDeposit(position=Point(x=h.x, y=h.y), soil_m3=h.soil_m3, pile=h.pile) for h in self)

    def state(self) -> tuple[HeapState, ...]:
        """Return what a snapshot keeps of the heaps."""
        return tuple(
            HeapState(number=h.number, x=h.x, y=h.y, soil_m3=h.soil_m3, slope=h.slope, fill=h.fill, pile=h.pile)
            for h in self
        )

    def restore(self, heaps: Iterable[HeapState], dug_m3: float) -> None:
        """Be as a snapshot says."""
        self.heaps = {h.number: Heap(h.number, h.x, h.y, h.soil_m3, h.slope, h.fill, h.pile) for h in heaps}
        self._next = max(self.heaps, default=-1) + 1
        self.dug_m3 = dug_m3

    def _add(self, heap: Heap) -> Heap:
        self.heaps[heap.number] = heap
        self._next += 1
        return heap
