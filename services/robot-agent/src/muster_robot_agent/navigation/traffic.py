"""Making way: who goes first where paths of robots meet, and when a robot must stop for another's body.

Of two driving robots the one with the lower id goes first; the other stops before it would come near the first one's
published path, and leaves that path if it stands on it. Robots that stand go first before everyone. This order is
total, so no two robots wait for each other.
"""

import math
from dataclasses import dataclass

import numpy as np
from muster_schemas.base import Pose
from numpy.typing import NDArray

from .controller import distances_along
from .costmap import Points

HORIZON_M = 15.0
"""Only this much of another's path is made way for; what lies farther is decided when it comes nearer."""
STALE_S = 0.6
"""Site time that the last word of another robot may be old: its period, at ten times real time, and the way here."""
STARTING_UP_M = 0.3
"""How far a robot gets in that time from a stand."""
LOOK_AHEAD_M = 8.0
"""How far along the own path conflicts are looked for."""


@dataclass(frozen=True)
class Neighbour:
    """Another robot as it matters to this one."""

    robot_id: str
    at: tuple[float, float]
    speed_mps: float
    path: Points
    """(n, 2): where it is about to drive, up to the horizon, its position first."""
    clearance_m: float
    """Distance of the centres at which the two footprints' circles touch."""
    goes_first: bool
    max_speed_mps: float

    @property
    def driving(self) -> bool:
        """Whether it is about to drive at all."""
        return len(self.path) > 1


@dataclass(frozen=True)
class Limit:
    """How far this robot may go on its path now."""

    stop_within_m: float = math.inf
    because_of: str | None = None
    in_the_way: bool = False
    """It stands on the path of a robot that goes first and comes near."""


def limit(points: Points, along: Points, max_speed_mps: float, neighbours: list[Neighbour]) -> Limit:
    """Return how far the robot may follow its path.

    Args:
        points: (n, 2) what lies ahead, the robot's own position first.
        along: (n,) distances along the path.
        max_speed_mps: of this robot.
        neighbours: the other robots.

    """
    result = Limit()
    for other in neighbours:
        if other.goes_first and other.driving:
            found = _limit_by(points, along, max_speed_mps, other)
            if found.in_the_way or found.stop_within_m < result.stop_within_m:
                in_the_way = found.in_the_way or result.in_the_way
                result = Limit(min(found.stop_within_m, result.stop_within_m), other.robot_id, in_the_way)
    return result


def _limit_by(points: Points, along: Points, max_speed_mps: float, other: Neighbour) -> Limit:
    keep_m = other.clearance_m + 0.15
    gaps = np.hypot(points[:, None, 0] - other.path[None, :, 0], points[:, None, 1] - other.path[None, :, 1])
    near = gaps < keep_m
    meets: NDArray[np.bool_] = np.any(near, axis=1)
    if not meets.any():
        return Limit()
    its_way = distances_along(other.path)
    entry = int(meets.argmax())
    leaves = np.flatnonzero(~meets[entry:])
    exit_at = float(along[entry + leaves[0]]) if len(leaves) else math.inf
    it_comes_after_m = float(its_way[np.any(near[entry:], axis=0).argmax()])
    i_am_through_s = exit_at / (0.6 * max_speed_mps) + 1.5
    it_is_there_s = max(it_comes_after_m, 0.0) / max(other.max_speed_mps, 0.1)
    if i_am_through_s < it_is_there_s:
        return Limit()
    if entry > 0:
        return Limit(max(float(along[entry - 1]) - 0.3, 0.0), other.robot_id)
    return _on_its_way(gaps, along, other, it_comes_after_m)


def _on_its_way(gaps: Points, along: Points, other: Neighbour, it_comes_after_m: float) -> Limit:
    nearest = gaps.min(axis=1)
    soon = along <= 2.0
    if it_comes_after_m < 0.5 and gaps[0, 0] <= nearest[0] + 0.1:
        # side by side: it drives away from here, so going is fine as long as it takes this robot away as well
        going_away = bool((np.diff(nearest[soon]) > -0.05).all())
        return Limit() if going_away else Limit(0.0, other.robot_id)
    return Limit(0.0, other.robot_id, in_the_way=True)


def safe_speed(
    pose: Pose, speed_mps: float, most_m: float, neighbours: list[Neighbour]
) -> tuple[float, Neighbour | None]:
    """Return the highest speed up to the wanted one that touches nobody, and the robot that makes it 0, if one does.

    Args:
        pose: of this robot.
        speed_mps: wanted; negative backwards.
        most_m: it goes no farther than this in any case.
        neighbours: the other robots.

    """
    body = None
    for share in (1.0, 0.5, 0.25):
        body = body_ahead(pose, share * speed_mps, most_m, neighbours)
        if body is None:
            return share * speed_mps, None
    return 0.0, body


def body_ahead(pose: Pose, speed_mps: float, most_m: float, neighbours: list[Neighbour]) -> Neighbour | None:
    """Return the robot that this one would touch or come too near to if it went on at this speed, or None.

    A motion that leads away from the other is free, so that robots which stand too close can part.
    """
    if speed_mps == 0.0:
        return None
    way = min(0.5 * abs(speed_mps) + speed_mps**2 / 2 + 0.1, most_m + 0.1)
    ahead = math.copysign(way, speed_mps)
    x, y = pose.x + ahead * math.cos(pose.yaw), pose.y + ahead * math.sin(pose.yaw)
    for other in neighbours:
        places = _soon(other)
        now = min(math.hypot(a - pose.x, b - pose.y) for a, b in places)
        then = min(_distance_to_segment(place, (pose.x, pose.y), (x, y)) for place in places)
        keep_m = other.clearance_m + 0.1 + (0.3 * abs(other.speed_mps) if len(places) == 1 else 0.0)
        if then < keep_m and then < now - 1e-3:
            return other
    return None


def _soon(other: Neighbour) -> list[tuple[float, float]]:
    """Return where a robot may be by now: its last word is up to `STALE_S` old, and it drives along its path."""
    if not other.driving:
        return [other.at]
    way = distances_along(other.path)
    farthest = STALE_S * abs(other.speed_mps) + STARTING_UP_M
    reach = [0.5 * farthest, farthest]
    return [
        other.at,
        *((float(np.interp(r, way, other.path[:, 0])), float(np.interp(r, way, other.path[:, 1]))) for r in reach),
    ]


def _distance_to_segment(point: tuple[float, float], start: tuple[float, float], end: tuple[float, float]) -> float:
    dx, dy = end[0] - start[0], end[1] - start[1]
    along = ((point[0] - start[0]) * dx + (point[1] - start[1]) * dy) / max(dx * dx + dy * dy, 1e-9)
    along = min(max(along, 0.0), 1.0)
    return math.hypot(point[0] - start[0] - along * dx, point[1] - start[1] - along * dy)
