"""Machines cannot pass through each other or through solids: a move that would press them together stops short."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from .machines.base import Machine
from .scene import Scene, yaw_quaternion

NEAR_M: Final = 0.3
"""Hulls farther apart than this need no look; more than a machine drives in a step."""
TOUCH_M: Final = 0.01
APART_M: Final = 0.05
"""Two that touched are apart again beyond this; more than TOUCH_M, so that one push counts once."""
DEEPER_M: Final = 1e-5
HALVINGS: Final = 5


@dataclass(frozen=True)
class Solid:
    """Something that stands in the way: its body in the scene and the circle around it."""

    name: str
    body: int
    x: float
    y: float
    radius_m: float


class Contacts:
    """Moves machines as far as others let them, and knows who touches whom."""

    def __init__(self, scene: Scene, machines: Sequence[Machine], handles: Sequence[int]) -> None:
        self._scene = scene
        self._machines = {m.id: (m, handle) for m, handle in zip(machines, handles, strict=True)}
        self._solids: tuple[Solid, ...] = ()
        self._touching: dict[str, frozenset[str]] = {m.id: frozenset() for m in machines}
        self._unsettled = set(self._machines)
        self.robot_contacts = 0
        self.place_machines()

    def place_machines(self) -> None:
        """Put all hulls where their machines now are, however far that is."""
        for machine, handle in self._machines.values():
            self._place(handle, (machine.x, machine.y, machine.yaw))

    def set_solids(self, solids: Iterable[Solid]) -> None:
        """Say what stands on the ground now, beside the machines."""
        self._solids = tuple(solids)
        self._unsettled = set(self._machines)

    def touching(self, robot_id: str) -> tuple[str, ...]:
        """Return the names of what a machine's hull is in contact with, sorted."""
        return tuple(sorted(self._touching[robot_id]))

    def move(self, machine: Machine, target: tuple[float, float, float]) -> None:
        """Drive a machine there, or as far as it can go before it presses harder on anything."""
        _, handle = self._machines[machine.id]
        others = [body for _, body in self._near(machine)]
        start = (machine.x, machine.y, machine.yaw)
        gaps = [self._scene.distance(handle, other, NEAR_M) for other in others]
        self._place(handle, target)
        if not self._presses(handle, others, gaps):
            machine.move_to(target)
        else:
            free, blocked = 0.0, 1.0
            for _ in range(HALVINGS):
                share = (free + blocked) / 2
                self._place(handle, _between(start, target, share))
                free, blocked = (free, share) if self._presses(handle, others, gaps) else (share, blocked)
            reached = _between(start, target, free)
            self._place(handle, reached)
            machine.move_to(reached)
            machine.stop()
        self._unsettled.add(machine.id)

    def update(self) -> None:
        """Find out who touches whom, after all have moved."""
        for robot_id in sorted(self._unsettled):
            self._settle(robot_id)
        self._unsettled = {r for r, names in self._touching.items() if names}

    def _settle(self, robot_id: str) -> None:
        machine, handle = self._machines[robot_id]
        before, now = self._touching[robot_id], set[str]()
        for name, body in self._near(machine):
            reach = APART_M if name in before else TOUCH_M
            if self._scene.distance(handle, body, NEAR_M) <= reach:
                now.add(name)
        for name in now - before:
            if name in self._machines and robot_id not in self._touching[name]:
                self.robot_contacts += 1
                self._touching[name] |= {robot_id}
        for name in before - now:
            if name in self._machines:
                self._touching[name] -= {robot_id}
        self._touching[robot_id] = frozenset(now)

    def _near(self, machine: Machine) -> list[tuple[str, int]]:
        """Return the name and body of everything whose circle comes near the machine's."""
        x, y, reach = machine.x, machine.y, machine.radius_m + NEAR_M
        robots = [
            (other.id, handle)
            for other, handle in self._machines.values()
            if other is not machine and math.hypot(other.x - x, other.y - y) < other.radius_m + reach
        ]
        solids = [(s.name, s.body) for s in self._solids if math.hypot(s.x - x, s.y - y) < s.radius_m + reach]
        return robots + solids

    def _presses(self, handle: int, others: Sequence[int], gaps: Sequence[float]) -> bool:
        """Whether it now overlaps something deeper than before: leaving an overlap is allowed."""
        for other, gap in zip(others, gaps, strict=True):
            now = self._scene.distance(handle, other, NEAR_M)
            if now < 0 and now < gap - DEEPER_M:
                return True
        return False

    def _place(self, handle: int, pose: tuple[float, float, float]) -> None:
        x, y, yaw = pose
        self._scene.place(handle, (x, y, 0.0), yaw_quaternion(yaw))


def _between(
    start: tuple[float, float, float], end: tuple[float, float, float], share: float
) -> tuple[float, float, float]:
    turn = math.remainder(end[2] - start[2], math.tau)
    return (
        start[0] + share * (end[0] - start[0]),
        start[1] + share * (end[1] - start[1]),
        math.remainder(start[2] + share * turn, math.tau),
    )
