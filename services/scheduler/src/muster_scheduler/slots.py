"""Where robots stand around an object: one distinct place each, facing it or with the rear to it. Pure geometry.

Metres and radians; x east, y north.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from muster_schemas.base import Point, Pose
from muster_schemas.site import Bounds

GAP_M = 0.7
"""Between an object's circle and the machine before it."""
CLEARANCE_M = 0.8
"""Between two robots, or a robot and anything else that it must not touch. Machines stand up to 0.3 m from where they
were sent and keep 0.25 m from one that stands, so a narrower gap could close a place for the second to come."""
BESIDE_M = 5.6
"""Centre to centre: nearer than this an excavator reaches well into the bed of a truck."""
DIRECTIONS = 48
RINGS = 8
RING_STEP_M = 0.8
REACH_MARGIN_M = 1.0
OUTWARDS_COST = 4.0
"""Metres of driving that a place may save for each metre that it is further out than it need be."""
OUT_OF_REACH_COST = 20.0


@dataclass(frozen=True, slots=True)
class Disc:
    """A round patch of ground."""

    centre: Point
    radius_m: float


@dataclass(frozen=True, slots=True)
class Machine:
    """A robot that wants a place."""

    robot_id: str
    pose: Pose
    length_m: float
    radius_m: float
    rear_first: bool
    """Stand with the rear to the object."""
    reach_m: float = 0.0
    """Of its tool, from its centre; 0: it needs no nearness."""
    keep_out: tuple[Disc, ...] = ()
    """Areas that this robot must not enter."""


def place(
    target: Disc, machine: Machine, bounds: Bounds, taken: Sequence[Disc], beside: Sequence[Point] = ()
) -> Pose | None:
    """Return the best free place for one machine at an object, or None if there is none.

    Args:
        target: the object.
        machine: who comes.
        bounds: of the site; the whole machine stays inside.
        taken: what it must not touch: other objects, other robots, places given to others.
        beside: machines that work with it; it wants to be within reach of the nearest.

    """
    near = [d for d in taken if d.centre.distance(target.centre) < d.radius_m + target.radius_m + 20.0]
    start, centre = machine.pose, target.centre
    away = start.distance(centre)
    best: tuple[float, float, float, float] | None = None
    for ring in range(RINGS):
        further_out = ring * RING_STEP_M
        distance = target.radius_m + machine.length_m / 2 + GAP_M + further_out
        outwards = OUTWARDS_COST * further_out
        if best is not None and best[0] <= abs(away - distance) + outwards:
            break  # no place on this ring or beyond can cost less
        outwards += OUT_OF_REACH_COST * _short_of_reach(distance - target.radius_m, machine)
        for x, y, yaw in _ring(centre, distance, machine):
            cost = math.hypot(x - start.x, y - start.y) + outwards + _apart(x, y, beside)
            if (best is None or cost < best[0]) and _is_free(x, y, machine, bounds, near):
                best = cost, x, y, yaw
    return Pose(x=best[1], y=best[2], yaw=best[3]) if best else None


def _short_of_reach(gap: float, machine: Machine) -> float:
    return max(0.0, gap - machine.reach_m + REACH_MARGIN_M) if machine.reach_m else 0.0


def _apart(x: float, y: float, beside: Sequence[Point]) -> float:
    """Return what it costs that a place is not beside any of the machines that work with this one."""
    if not beside:
        return 0.0
    return OUT_OF_REACH_COST * max(0.0, min(math.hypot(b.x - x, b.y - y) for b in beside) - BESIDE_M)


def stands_right(target: Disc, machine: Machine) -> bool:
    """Return whether the machine can work at the object from where it is: in reach, and turned as it should be."""
    gap = machine.pose.distance(target.centre) - target.radius_m
    if not machine.rear_first:
        return gap <= (machine.reach_m - REACH_MARGIN_M if machine.reach_m else machine.length_m / 2 + 3 * GAP_M)
    away = math.atan2(machine.pose.y - target.centre.y, machine.pose.x - target.centre.x)
    turned = abs(math.remainder(machine.pose.yaw - away, 2 * math.pi))
    return gap <= machine.length_m / 2 + 3 * GAP_M and turned < math.pi / 6


def _ring(centre: Point, distance: float, machine: Machine) -> Iterator[tuple[float, float, float]]:
    """Yield (x, y, yaw) of the places at one distance around an object, beginning on the machine's own side."""
    own_side = math.atan2(machine.pose.y - centre.y, machine.pose.x - centre.x)
    for step in range(DIRECTIONS):
        angle = own_side + step * 2 * math.pi / DIRECTIONS
        yaw = angle if machine.rear_first else angle + math.pi
        place_x, place_y = centre.x + distance * math.cos(angle), centre.y + distance * math.sin(angle)
        yield place_x, place_y, math.remainder(yaw, 2 * math.pi)


def _is_free(x: float, y: float, machine: Machine, bounds: Bounds, taken: Sequence[Disc]) -> bool:
    margin = machine.radius_m
    return (
        bounds.min_x + margin <= x <= bounds.max_x - margin
        and bounds.min_y + margin <= y <= bounds.max_y - margin
        and all(_clear(x, y, d, margin + CLEARANCE_M) for d in taken)
        and all(_clear(x, y, d, margin) for d in machine.keep_out)
    )


def _clear(x: float, y: float, disc: Disc, margin: float) -> bool:
    return math.hypot(disc.centre.x - x, disc.centre.y - y) >= disc.radius_m + margin
