"""How loads change hands: what a bucket digs, where it falls, what a tipped bed drops."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from .bodies import Body
from .machines.base import Cargo, Machine
from .machines.dump_truck import DumpTruck
from .machines.excavator import Excavator, Grip
from .soil import Ground

GRASP_M: Final = 0.35
"""How far beyond its edge a bucket's tip still gets hold of a body."""
SPILL_M: Final = 0.6
"""How far beside a full bed the surplus lands."""


@dataclass(frozen=True)
class Bite:
    """What a curling bucket has got hold of: a body, or soil at a place below its surface."""

    x: float
    y: float
    depth_m: float
    body: str | None = None


class Loading:
    """Moves soil and bodies between ground, buckets and beds."""

    def __init__(self, ground: Ground, bodies: Mapping[str, Body], machines: Sequence[Machine]) -> None:
        self._ground = ground
        self._bodies = bodies
        self._trucks = [m for m in machines if isinstance(m, DumpTruck)]
        self._bites: dict[str, Bite] = {}

    def after_joints(self, machine: Machine) -> bool:
        """Do what follows from a machine's joints having moved; return whether any load or soil changed place."""
        if isinstance(machine, Excavator):
            return self._bucket_moved(machine)
        if isinstance(machine, DumpTruck):
            return self._empty_if_tipped(machine)
        return False

    def _bucket_moved(self, excavator: Excavator) -> bool:
        before, news = excavator.grip, excavator.update_grip()
        if excavator.grip is Grip.OPEN:
            self._bites.pop(excavator.id, None)
            return news is Grip.OPEN and self._release(excavator)
        if Grip.HOLDS not in (before, excavator.grip) or news is Grip.HOLDS:
            self._bite(excavator)
        return news is Grip.HOLDS and self._fill(excavator)

    def _bite(self, excavator: Excavator) -> None:
        """Remember the best that the tip has met during this curl: a body before soil, deep before shallow."""
        x, y, z = excavator.tip()
        best = self._bites.get(excavator.id)
        if best is not None and best.body is not None:
            return
        for body in self._bodies.values():
            in_reach = body.solid and body.carrier is None and body.distance(x, y) <= body.radius_m + GRASP_M
            if in_reach and z <= body.height_m and excavator.cargo.empty:
                self._bites[excavator.id] = Bite(x, y, 0.0, body.name)
                return
        depth = self._ground.surface_m(x, y) - z
        if depth > 0 and (best is None or depth > best.depth_m):
            self._bites[excavator.id] = Bite(x, y, depth)

    def _fill(self, excavator: Excavator) -> bool:
        bite, cargo = self._bites.pop(excavator.id, None), excavator.cargo
        if bite is None:
            return False
        if bite.body is not None:
            body = self._bodies[bite.body]
            if body.carrier is not None:
                return False
            body.carrier = excavator.id
            cargo.bodies.append(body.name)
            return True
        room = excavator.kind.capacity_m3 - cargo.soil_m3
        if cargo.bodies or room <= 0:
            return False
        cargo.soil_m3 += self._ground.take(bite.x, bite.y, room)
        return True

    def _release(self, excavator: Excavator) -> bool:
        if excavator.cargo.empty:
            return False
        x, y, z = excavator.bucket_centre()
        fallen = excavator.cargo.unload()
        below = [t for t in self._trucks if t.under(x, y, z)]
        if not below:
            self._drop(fallen, x, y)
            return True
        truck = min(below, key=lambda t: math.hypot(t.x - x, t.y - y))
        taken = min(fallen.soil_m3, max(0.0, truck.kind.capacity_m3 - truck.cargo.soil_m3))
        truck.cargo.soil_m3 += taken
        for name in fallen.bodies:
            truck.cargo.bodies.append(name)
            self._bodies[name].carrier = truck.id
        # a full bed overflows on the side away from the excavator's tracks
        left = 1.0 if _side(truck, excavator) < 0 else -1.0
        self._drop(Cargo(fallen.soil_m3 - taken), *truck.place(0.0, left * (truck.kind.width_m / 2 + SPILL_M)))
        self._empty_if_tipped(truck)
        return True

    def _empty_if_tipped(self, truck: DumpTruck) -> bool:
        if not truck.tipped or truck.cargo.empty:
            return False
        self._drop(truck.cargo.unload(), *truck.drop_point)
        return True

    def _drop(self, cargo: Cargo, x: float, y: float) -> None:
        """Let it land there; several bodies come to rest side by side."""
        if cargo.soil_m3 > 0:
            self._ground.drop(x, y, cargo.soil_m3)
        for name in cargo.bodies:
            body, angle = self._bodies[name], 0.0
            spot = (x, y)
            while any(
                b.carrier is None and b.solid and b is not body and b.distance(*spot) < b.radius_m + body.radius_m
                for b in self._bodies.values()
            ):
                angle += math.pi / 4
                away = body.radius_m * (1 + angle / math.pi)
                spot = (x + away * math.cos(angle), y + away * math.sin(angle))
            body.lay(*spot)


def _side(truck: Machine, other: Machine) -> float:
    """Return how far left of the truck's middle line the other stands."""
    return (other.y - truck.y) * math.cos(truck.yaw) - (other.x - truck.x) * math.sin(truck.yaw)
