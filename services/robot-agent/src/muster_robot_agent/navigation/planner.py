"""Shortest paths on the cost map: A* over eight neighbours, then straightened."""

import heapq
import math
from collections.abc import Callable

import numpy as np
from muster_schemas.base import Point

from .costmap import CELL_M, CostMap, Points

_SAMPLE_M = 0.25


def find_path(grid: CostMap, start: Point, goal: Point) -> Points | None:
    """Return a straightened path from start to goal, (n, 2) metres with both ends, or None if there is none."""
    target = grid.cell(goal)
    if not np.isfinite(grid.cost.flat[target]):
        return None
    goal_x, goal_y = grid.centre(target)

    def to_goal(cell: int) -> float:
        x, y = grid.centre(cell)
        across, along = abs(x - goal_x), abs(y - goal_y)
        return max(across, along) + (math.sqrt(2) - 1) * min(across, along)

    cells = _search(grid, grid.cell(start), lambda cell: cell == target, to_goal)
    if cells is None:
        return None
    middle = [grid.centre(c) for c in cells[1:-1]]
    return _straightened(grid, np.array([(start.x, start.y), *middle, (goal.x, goal.y)], dtype=np.float64))


def find_way_out(grid: CostMap, start: Point, allowed: Callable[[int], bool]) -> Points | None:
    """Return the cheapest path to the nearest cell that is allowed, (n, 2) metres, or None if there is none."""
    cells = _search(grid, grid.cell(start), allowed, lambda _: 0.0)
    if cells is None:
        return None
    return np.array([(start.x, start.y), *(grid.centre(c) for c in cells[1:])], dtype=np.float64)


def _search(
    grid: CostMap, start: int, is_goal: Callable[[int], bool], estimate: Callable[[int], float]
) -> list[int] | None:
    columns, rows = grid.columns, grid.rows
    cost: list[float] = grid.cost.ravel().tolist()
    # the robot stands where it stands, whatever the map says of that cell
    cost[start] = min(cost[start], 10.0)
    steps = [(dx, dy, dy * columns + dx, CELL_M * math.hypot(dx, dy)) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
    steps = [s for s in steps if s[2] or s[0]]
    best = {start: 0.0}
    came_from: dict[int, int] = {}
    done = bytearray(len(cost))
    queue = [(estimate(start), start)]
    while queue:
        _, cell = heapq.heappop(queue)
        if done[cell]:
            continue
        done[cell] = 1
        if is_goal(cell):
            return _traced(came_from, cell)
        row, column = divmod(cell, columns)
        so_far, here = best[cell], cost[cell]
        for dx, dy, offset, length in steps:
            if not (0 <= column + dx < columns and 0 <= row + dy < rows):
                continue
            beside = cell + offset
            there = cost[beside]
            if done[beside] or there == math.inf:
                continue
            total = so_far + length * (here + there) / 2
            if total < best.get(beside, math.inf):
                best[beside] = total
                came_from[beside] = cell
                heapq.heappush(queue, (total + estimate(beside), beside))
    return None


def _traced(came_from: dict[int, int], cell: int) -> list[int]:
    cells = [cell]
    while cell in came_from:
        cell = came_from[cell]
        cells.append(cell)
    return cells[::-1]


def _straightened(grid: CostMap, points: Points) -> Points:
    """Leave out the corners that a straight line may pass without coming nearer to anything than the path does."""
    kept = [0]
    while kept[-1] < len(points) - 1:
        here = kept[-1]
        reach = here + 1
        step = len(points) - 1 - here
        # halving finds a far corner in few tests; that it may miss the farthest one costs nothing but a corner
        while step > 1:
            if _clear(grid, points, here, here + step):
                reach = here + step
                break
            step //= 2
        kept.append(reach)
    return points[kept]


def _clear(grid: CostMap, points: Points, first: int, last: int) -> bool:
    start, end = points[first], points[last]
    length = float(np.hypot(*(end - start)))
    count = max(int(length / _SAMPLE_M), 2)
    line = start + (end - start) * np.linspace(0, 1, count)[1:-1, None]
    if len(line) == 0:
        return True
    straight = grid.at(line)
    around = grid.at(points[first + 1 : last])
    return bool(np.isfinite(straight).all() and straight.max() <= max(float(around.max()), 1.0) + 0.25)
