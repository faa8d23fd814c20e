"""The grid on which paths are searched: what a robot's centre must not enter, and what it had better not come near."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from muster_schemas.base import Point
from muster_schemas.site import Bounds
from numpy.typing import NDArray

Grid = NDArray[np.float32]
Points = NDArray[np.float64]
"""(n, 2) metres."""

CELL_M = 0.5


@dataclass(frozen=True)
class Circle:
    """Around a thing: no centre of this robot within `hard_m`, and better none within `soft_m` more."""

    name: str
    x: float
    y: float
    hard_m: float
    soft_m: float = 1.0
    soft_cost: float = 2.0
    firm_m: float = 0.0
    """What `hard_m` may shrink to where the robot or its goal stands closer than that."""

    def distance(self, point: Point) -> float:
        """Return the distance from the centre in metres."""
        return math.hypot(point.x - self.x, point.y - self.y)


class CostMap:
    """Costs of a metre at each cell, (rows of y, columns of x); infinite where a path must not go."""

    def __init__(self, bounds: Bounds, margin_m: float, *inside: Point) -> None:
        """Make an empty map of the bounds less a margin.

        Args:
            bounds: of the site.
            margin_m: how far the centre keeps from the bounds.
            inside: points that must be on the map even if they are closer to the bounds than that, or outside.

        """
        self.min_x = min(bounds.min_x + margin_m, *(p.x for p in inside))
        self.min_y = min(bounds.min_y + margin_m, *(p.y for p in inside))
        max_x = max(bounds.max_x - margin_m, *(p.x for p in inside))
        max_y = max(bounds.max_y - margin_m, *(p.y for p in inside))
        self.columns = int((max_x - self.min_x) / CELL_M) + 1
        self.rows = int((max_y - self.min_y) / CELL_M) + 1
        self.cost: Grid = np.ones((self.rows, self.columns), dtype=np.float32)
        self._x = self.min_x + CELL_M * np.arange(self.columns)
        self._y = self.min_y + CELL_M * np.arange(self.rows)

    def cell(self, point: Point) -> int:
        """Return the flat index of the cell nearest to a point."""
        column = min(max(round((point.x - self.min_x) / CELL_M), 0), self.columns - 1)
        row = min(max(round((point.y - self.min_y) / CELL_M), 0), self.rows - 1)
        return row * self.columns + column

    def centre(self, cell: int) -> tuple[float, float]:
        """Return the middle of a cell in metres."""
        row, column = divmod(cell, self.columns)
        return self.min_x + CELL_M * column, self.min_y + CELL_M * row

    def add(self, circles: Iterable[Circle]) -> None:
        """Put circles on the map; costs do not add up, the highest holds."""
        for circle in circles:
            window, distance = self._around(circle.x, circle.y, circle.hard_m + circle.soft_m)
            cost = self.cost[window]
            near = 1 + circle.soft_cost * np.clip(1 - (distance - circle.hard_m) / max(circle.soft_m, 1e-6), 0, 1)
            np.maximum(cost, near, out=cost)
            cost[distance < circle.hard_m] = np.inf

    def near(self, points: Points, within_m: float) -> NDArray[np.bool_]:
        """Return which cells are within a distance of any of the points, shaped like the map."""
        mask = np.zeros(self.cost.shape, dtype=np.bool_)
        for x, y in points:
            window, distance = self._around(float(x), float(y), within_m)
            mask[window] |= distance < within_m
        return mask

    def free(self, points: Points) -> bool:
        """Return whether none of the points lies in a cell that a path must not enter."""
        return bool(np.isfinite(self.at(points)).all())

    def at(self, points: Points) -> NDArray[np.float32]:
        """Return the cost at each point, (n,)."""
        columns = np.clip(np.rint((points[:, 0] - self.min_x) / CELL_M).astype(np.intp), 0, self.columns - 1)
        rows = np.clip(np.rint((points[:, 1] - self.min_y) / CELL_M).astype(np.intp), 0, self.rows - 1)
        return self.cost[rows, columns]

    def _around(self, x: float, y: float, reach_m: float) -> tuple[tuple[slice, slice], NDArray[np.float64]]:
        left, right = np.searchsorted(self._x, (x - reach_m, x + reach_m))
        low, high = np.searchsorted(self._y, (y - reach_m, y + reach_m))
        window = (slice(int(low), int(high)), slice(int(left), int(right)))
        return window, np.hypot(self._x[window[1]][None, :] - x, self._y[window[0]][:, None] - y)


def fitted(circles: Iterable[Circle], *standing: Point) -> list[Circle]:
    """Return the circles made so small that none holds a point where the robot stands or is sent.

    What is already too near may be left but not approached; no circle shrinks below its `firm_m`.
    """
    slack_m = CELL_M * 0.75
    result: list[Circle] = []
    for circle in circles:
        hard = min([circle.hard_m, *(circle.distance(p) - slack_m for p in standing)])
        hard = max(hard, min(circle.firm_m, circle.hard_m), 0.0)
        result.append(
            Circle(circle.name, circle.x, circle.y, hard, circle.soft_m, circle.soft_cost, firm_m=circle.firm_m)
        )
    return result
