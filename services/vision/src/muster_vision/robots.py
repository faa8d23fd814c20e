"""Where robots stand in the way: what they hide from the cameras, and what their arms may cover."""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np
from muster_schemas.robot import RobotState
from muster_schemas.site import RobotType, Site

from .birdseye import BirdsEye, Mask
from .camera import Floats
from .outline import Shape

HEIGHT_M: Final = 2.4
MARGIN_M: Final = 0.3
KEPT: Final = 40
"""Poses kept of each robot: 8 s at 5 Hz."""
AROUND_S: Final = 0.6
"""Poses this near to a picture's time count: clocks differ a little, and robots move on between two messages."""
UNKNOWN: Final = RobotType(length_m=4.5, width_m=3.0, max_speed_mps=2.0, reach_m=7.5)
"""What is assumed of a robot that the site's file does not name."""


@dataclass(frozen=True)
class Stand:
    """A robot at a place."""

    x: float
    y: float
    yaw: float
    kind: RobotType

    @property
    def corners(self) -> Floats:
        """Ground polygon (N, 2) around it; whatever has an arm swings its house, so that is round."""
        if self.kind.reach_m > 0:
            radius = 0.65 * self.kind.length_m
            turns = np.linspace(0, 2 * math.pi, 16, endpoint=False)
            return np.array([self.x, self.y]) + (radius + MARGIN_M) * np.column_stack([np.cos(turns), np.sin(turns)])
        half = np.array([self.kind.length_m, self.kind.width_m]) / 2 + MARGIN_M
        signs = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([self.x, self.y]) + (signs * half) @ np.array([[cos, sin], [-sin, cos]])


@dataclass(frozen=True)
class Shadows:
    """What robots may hide at the time of a look."""

    mask: Mask
    """Cells in which a robot's hull is, or may hide the ground."""
    near: Mask
    """The same, and a little around."""
    stands: tuple[Stand, ...]

    def may_cover(self, shape: Shape) -> bool:
        """Whether a hull or an arm may lie over part of a thing."""
        if (self.near[shape.window.cells] & shape.mask).any():
            return True
        x, y = float(shape.centre[0]), float(shape.centre[1])
        return any(
            s.kind.reach_m > 0 and math.hypot(s.x - x, s.y - y) < s.kind.reach_m + shape.length_m / 2
            for s in self.stands
        )


@dataclass
class RobotWatch:
    """The latest poses of all robots."""

    site: Site
    _poses: dict[str, deque[RobotState]] = field(default_factory=dict[str, "deque[RobotState]"])

    def take(self, state: RobotState) -> None:
        """Take in a robot's state."""
        self._poses.setdefault(state.robot_id, deque(maxlen=KEPT)).append(state)

    def stands(self, times: Iterable[float]) -> tuple[Stand, ...]:
        """Return where robots stood around the times that the pictures were taken, and where each one was last."""
        moments = tuple(times)
        kinds = {r.id: self.site.robot_types[r.type] for r in self.site.robots}
        found: dict[tuple[float, float, float, str], Stand] = {}
        for robot_id, states in self._poses.items():
            for state in states:
                if state is states[-1] or any(abs(state.at - t) < AROUND_S for t in moments):
                    # standing still for seconds must not make the same mask many times
                    place = (round(state.pose.x, 1), round(state.pose.y, 1), round(state.pose.yaw, 1), robot_id)
                    kind = kinds.get(robot_id, UNKNOWN)
                    found[place] = Stand(state.pose.x, state.pose.y, state.pose.yaw, kind)
        return tuple(found.values())


def shadows(view: BirdsEye, stands: Iterable[Stand]) -> Shadows:
    """Return what robots hide in a view: their hulls, and the ground behind them as its cameras see them."""
    grid, all_stands = view.grid, tuple(stands)
    mask = np.zeros((grid.rows, grid.columns), np.uint8)
    for stand in all_stands:
        corners = stand.corners
        for layer in view.layers.values():
            away, tangent = layer.view.sight(np.array([stand.x, stand.y]))
            # a camera below the robot's top, or one that hardly sees it, says nothing about what it hides
            if layer.view.centre[2] > 2 * HEIGHT_M and tangent < 2.0:
                top = corners + away * tangent * HEIGHT_M
                hull = cv2.convexHull(np.vstack([corners, top]).astype(np.float32)).reshape(-1, 2)
                cells = np.round(grid.to_cells(hull.astype(np.float64))).astype(np.int32)
                cv2.fillConvexPoly(mask, cells, 1)
    side = 2 * round(MARGIN_M / grid.cell_m) + 1
    near = cv2.dilate(mask, np.ones((side, side), np.uint8)) if all_stands else mask
    return Shadows(mask.astype(np.bool_), near.astype(np.bool_), all_stands)
