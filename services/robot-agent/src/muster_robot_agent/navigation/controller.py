"""Following a path with tracks: regulated pure pursuit that turns on the spot, and reverses over short ways back."""

import math
from itertools import pairwise

import numpy as np
from muster_schemas.base import Point, Pose
from numpy.typing import NDArray

from muster_robot_agent.kinematics import wrap

from .costmap import Points

TURN_FIRST_RAD = 0.7
"""A greater error of heading is turned away on the spot ..."""
TURNED_RAD = 0.2
"""... until it is this small."""
REVERSE_WITHIN_M = 4.0
"""Ways no longer than this are driven backwards if they lead backwards."""


class PathFollower:
    """Steers along one path. The position on it only grows."""

    def __init__(self, points: Points, pose: Pose, max_speed_mps: float, max_turn_radps: float) -> None:
        self.points = dense(points)
        self._along: NDArray[np.float64] = distances_along(self.points)
        self._max_speed = max_speed_mps
        self._max_turn = max_turn_radps
        self._at = 0
        self._turning = True
        ahead = self._point(1.5)
        first = wrap(math.atan2(ahead[1] - pose.y, ahead[0] - pose.x) - pose.yaw)
        self._backwards = float(self._along[-1]) < REVERSE_WITHIN_M and abs(first) > 2.0

    @property
    def length(self) -> float:
        """Length of the whole path in metres."""
        return float(self._along[-1])

    @property
    def remaining(self) -> float:
        """What is left of it in metres."""
        return self.length - float(self._along[self._at])

    def ahead(self, pose: Point, within_m: float) -> tuple[Points, NDArray[np.float64]]:
        """Return what lies ahead as points (n, 2) and their distances along the path (n,), starting where it is."""
        self._advance(pose)
        end = int(np.searchsorted(self._along, float(self._along[self._at]) + within_m, side="right"))
        points = np.concatenate([[(pose.x, pose.y)], self.points[self._at + 1 : max(end, self._at + 2)]])
        along = np.concatenate(
            [np.zeros(1), self._along[self._at + 1 : max(end, self._at + 2)] - self._along[self._at]]
        )
        return points, along

    def steer(self, pose: Pose, stop_within_m: float) -> tuple[float, float]:
        """Return (speed m/s, turn rad/s) that follow the path and stand after `stop_within_m` at the latest."""
        self._advance(pose)
        remaining = max(self.remaining, math.hypot(self.points[-1, 0] - pose.x, self.points[-1, 1] - pose.y))
        if stop_within_m <= 0.05:
            return 0.0, 0.0
        look = 0.9 + 0.35 * self._max_speed
        target = self._point(float(self._along[self._at]) + look)
        distance = math.hypot(target[0] - pose.x, target[1] - pose.y)
        yaw = pose.yaw + math.pi if self._backwards else pose.yaw
        error = wrap(math.atan2(target[1] - pose.y, target[0] - pose.x) - yaw)
        if self._turning or abs(error) > TURN_FIRST_RAD:
            self._turning = abs(error) > TURNED_RAD
            if self._turning:
                return 0.0, turn_towards(error, self._max_turn)
        speed = self._max_speed * (0.6 if self._backwards else 1.0)
        speed = min(speed, 0.7 * remaining + 0.08, 0.8 * stop_within_m)
        curvature = 2 * math.sin(error) / max(distance, 0.3)
        if abs(curvature) > 1e-6:
            speed = min(speed, max(0.8 * self._max_turn / abs(curvature), 0.1))
        turn = min(max(speed * curvature, -self._max_turn), self._max_turn)
        return (-speed if self._backwards else speed), turn

    def _advance(self, pose: Point) -> None:
        window = self.points[self._at : self._at + 12]
        gaps = np.hypot(window[:, 0] - pose.x, window[:, 1] - pose.y)
        self._at += int(gaps.argmin())

    def _point(self, along: float) -> tuple[float, float]:
        return (
            float(np.interp(along, self._along, self.points[:, 0])),
            float(np.interp(along, self._along, self.points[:, 1])),
        )


def distances_along(points: Points) -> NDArray[np.float64]:
    """Return how far along the line each of its points is, (n,) metres, beginning with 0."""
    steps = points[1:] - points[:-1]
    lengths: NDArray[np.float64] = np.hypot(steps[:, 0], steps[:, 1])
    return np.concatenate([np.zeros(1), np.cumsum(lengths)])


def turn_towards(error_rad: float, max_turn_radps: float) -> float:
    """Return a turning rate that removes an error of heading without overshooting under a slow link."""
    rate = min(abs(error_rad) * 1.2 + 0.03, max_turn_radps)
    return math.copysign(rate, error_rad)


def dense(points: Points) -> Points:
    """Return the same line with a point at least every half metre."""
    parts = [points[:1]]
    for start, end in pairwise(points):
        count = max(math.ceil(float(np.hypot(*(end - start))) / 0.5), 1)
        parts.append(start + (end - start) * np.linspace(0, 1, count + 1)[1:, None])
    return np.concatenate(parts)
