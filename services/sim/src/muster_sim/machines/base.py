"""What every machine has: tracks, joints with limits, a load, and a stop when commands cease."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from muster_schemas.base import Pose
from muster_schemas.machines import JointLimit
from muster_schemas.robot import Load
from muster_schemas.sim import DriveCommand, ToolCommand
from muster_schemas.site import RobotEntry, RobotType

from muster_sim.scene import Hull, Link, Part
from muster_sim.snapshot import MachineState

SPEEDING_UP_MPS2: Final = 1.5
BRAKING_MPS2: Final = 3.0
TURNING_RADPS2: Final = 2.5
MOVED: Final = 1e-9


class CommandError(ValueError):
    """A command that this machine cannot follow; nothing was changed. The message says what it takes."""


@dataclass
class Cargo:
    """What is in a bucket or bed."""

    soil_m3: float = 0.0
    bodies: list[str] = field(default_factory=list[str])

    @property
    def empty(self) -> bool:
        """Whether there is nothing at all in it."""
        return self.soil_m3 <= 0 and not self.bodies

    def unload(self) -> "Cargo":
        """Return all of it and keep nothing."""
        gone = Cargo(self.soil_m3, self.bodies)
        self.soil_m3, self.bodies = 0.0, []
        return gone

    def message(self) -> Load:
        """Return it as the bus has it."""
        return Load(soil_m3=self.soil_m3, bodies=tuple(self.bodies))


class Machine(ABC):
    """A tracked vehicle. Positions in metres and radians on the site, speeds per second of site time."""

    joint_limits: Mapping[str, JointLimit] = {}

    def __init__(self, entry: RobotEntry, kind: RobotType, command_timeout_s: float, rest: Mapping[str, float]) -> None:
        self.id = entry.id
        self.kind = kind
        self.radius_m = math.hypot(kind.length_m, kind.width_m) / 2
        """Of the circle around the hull."""
        self.x, self.y, self.yaw = entry.home.x, entry.home.y, entry.home.yaw
        self.speed = 0.0
        self.turn = 0.0
        self.joints = dict(rest)
        self.cargo = Cargo()
        self._timeout_s = command_timeout_s
        self._targets = dict(rest)
        self._wanted = (0.0, 0.0)
        self._drive_ends = 0.0
        self._tool_ends = 0.0

    @property
    @abstractmethod
    def base(self) -> Sequence[Part]:
        """The boxes of the undercarriage, in the robot's frame."""

    @property
    @abstractmethod
    def links(self) -> Sequence[Link]:
        """The moving parts, in the order of `joints`."""

    @property
    def hull(self) -> Hull:
        """What others cannot drive into: the tracks' footprint."""
        return Hull(self.kind.length_m / 2, self.kind.width_m / 2, 1.5)

    @property
    def pose(self) -> Pose:
        """Where it stands."""
        return Pose(x=self.x, y=self.y, yaw=self.yaw)

    def place(self, forward: float, left: float = 0.0, turned: float = 0.0) -> tuple[float, float]:
        """Return the site's (x, y) of a place in the robot's frame, or of one in its upper body turned by `turned`."""
        angle = self.yaw + turned
        cos, sin = math.cos(angle), math.sin(angle)
        return self.x + forward * cos - left * sin, self.y + forward * sin + left * cos

    def drive(self, command: DriveCommand, now_s: float) -> None:
        """Take a wanted speed and turning rate; what is more than the machine can do is cut."""
        most, turn = self.kind.max_speed_mps, self.kind.max_turn_radps
        self._wanted = (_cut(command.speed_mps, most), _cut(command.turn_radps, turn))
        self._drive_ends = self._tool_ends = now_s + self._timeout_s

    def move_tool(self, command: ToolCommand, now_s: float) -> None:
        """Take joint targets; those beyond a joint's range are cut.

        Raises:
            CommandError: the machine lacks one of the joints.

        """
        for name in command.joints:
            if name not in self.joint_limits:
                known = ", ".join(self.joint_limits) or "none"
                raise CommandError(f"{self.id} has no joint {name[:32]!r}; its joints: {known}")
        for name, angle in command.joints.items():
            limit = self.joint_limits[name]
            self._targets[name] = min(max(angle, limit.low), limit.high)
        self._tool_ends = now_s + self._timeout_s

    def advance_joints(self, now_s: float, dt: float) -> bool:
        """Turn the joints towards their targets; return whether any moved. Without commands they stop."""
        if now_s > self._tool_ends:
            self._targets = dict(self.joints)
        moved = False
        for name, angle in self.joints.items():
            gap = self._targets[name] - angle
            if abs(gap) > MOVED:
                self.joints[name] = angle + _cut(gap, self.joint_limits[name].speed_radps * dt)
                moved = True
        return moved

    def next_pose(self, now_s: float, dt: float) -> tuple[float, float, float] | None:
        """Change the speeds by what the drives allow and return where they lead, or None when it stands still."""
        speed, turn = self._wanted if now_s <= self._drive_ends else (0.0, 0.0)
        slower = abs(speed) < abs(self.speed) or speed * self.speed < 0
        rate = BRAKING_MPS2 if slower else SPEEDING_UP_MPS2
        self.speed += _cut(speed - self.speed, rate * dt)
        self.turn += _cut(turn - self.turn, TURNING_RADPS2 * dt)
        if abs(self.speed) < MOVED and abs(self.turn) < MOVED:
            return None
        yaw = math.remainder(self.yaw + self.turn * dt, math.tau)
        # the heading half way is exact to second order
        middle = self.yaw + self.turn * dt / 2
        return self.x + self.speed * dt * math.cos(middle), self.y + self.speed * dt * math.sin(middle), yaw

    def move_to(self, pose: tuple[float, float, float]) -> None:
        """Stand there."""
        self.x, self.y, self.yaw = pose

    def state(self) -> MachineState:
        """Return what a snapshot keeps of it."""
        return MachineState(pose=self.pose, joints=dict(self.joints), load=self.cargo.message())

    def restore(self, state: MachineState) -> None:
        """Stand as a snapshot says, with what was loaded, and wait for commands."""
        self.move_to((state.pose.x, state.pose.y, state.pose.yaw))
        self.stop()
        self.joints.update(state.joints)
        self._targets = dict(self.joints)
        self._wanted = (0.0, 0.0)
        self.cargo = Cargo(state.load.soil_m3, list(state.load.bodies))

    def stop(self) -> None:
        """Lose all speed at once: it ran into something."""
        self.speed = self.turn = 0.0


def tracks(length: float, width: float, gauge_share: float = 0.22, height: float = 0.55) -> tuple[Part, ...]:
    """Return two crawler tracks with a belly between them."""
    broad = width * gauge_share
    at = (width - broad) / 2
    dark, belly = (0.13, 0.13, 0.14), (0.24, 0.24, 0.25)
    return (
        Part((length, broad, height), (0, at, height / 2), dark),
        Part((length, broad, height), (0, -at, height / 2), dark),
        Part((length * 0.7, width - 2 * broad, height * 0.6), (0, 0, height * 0.7), belly),
    )


def _cut(value: float, most: float) -> float:
    return min(max(value, -most), most)
