"""The robot as its skills see it: last telemetry in, wanted motion out, and the load that it arrived with."""

from collections.abc import Generator
from dataclasses import dataclass, field

from muster_schemas.base import Point, Pose
from muster_schemas.robot import Load, RobotCard
from muster_schemas.sim import Telemetry
from muster_schemas.site import RobotType

from .kinematics import Joints
from .surroundings import Surroundings

Steps = Generator[None, None, None]
"""A piece of a skill: each `yield` waits for the next telemetry."""


class SkillFailedError(Exception):
    """A skill cannot reach its effect; the message says why, for a person."""


@dataclass(frozen=True)
class Order:
    """What the machine is to do until the next order: track motion, and joint positions to hold or move to."""

    speed_mps: float = 0.0
    turn_radps: float = 0.0
    joints: Joints = field(default_factory=Joints)


class Machine:
    """One robot's body. Skills call `drive` and `move` each step; what they do not ask for stands still."""

    def __init__(self, card: RobotCard, robot_type: RobotType, surroundings: Surroundings, first: Telemetry) -> None:
        self.card = card
        self.type = robot_type
        self.surroundings = surroundings
        self.telemetry = first
        self.arrival_soil_m3 = first.load.soil_m3
        """The soil that was in it when it came to where it stands: what a loading has to exceed."""
        self.arrival_bodies = len(first.load.bodies)
        self.path: tuple[Point, ...] = ()
        """Where it is about to drive, for the other robots."""
        self.progress = 0.0
        self.note: str | None = None
        """What a person should know about the success, such as that the bucket was empty."""
        self._speed = self._turn = 0.0
        self._joints: Joints = {}
        self._stood_at = first.pose
        self._held_s = 0.0

    @property
    def pose(self) -> Pose:
        """Where it stands."""
        return self.telemetry.pose

    @property
    def load(self) -> Load:
        """What is in its bucket or bed."""
        return self.telemetry.load

    @property
    def loaded_here(self) -> bool:
        """Whether the load has grown since it came to where it stands."""
        return self.load.soil_m3 > self.arrival_soil_m3 + 0.05 or len(self.load.bodies) > self.arrival_bodies

    @property
    def now(self) -> float:
        """Site time in seconds without pauses, so that no patience runs out while a skill is held."""
        return self.telemetry.site_time_s - self._held_s

    @property
    def still(self) -> bool:
        """Whether the tracks stand."""
        return abs(self.telemetry.speed_mps) < 0.05 and abs(self.telemetry.turn_radps) < 0.05

    def sense(self, telemetry: Telemetry, *, working: bool = True) -> None:
        """Take in new telemetry and forget the last order of motion; time that is not for working stands still."""
        if not working:
            self._held_s += telemetry.site_time_s - self.telemetry.site_time_s
        self.telemetry = telemetry
        self._speed = self._turn = 0.0
        load = telemetry.load
        moved = self._stood_at.distance(telemetry.pose) > 1.0
        if moved:
            self._stood_at = telemetry.pose
        if moved or load.soil_m3 < self.arrival_soil_m3:
            self.arrival_soil_m3 = load.soil_m3
        if moved or len(load.bodies) < self.arrival_bodies:
            self.arrival_bodies = len(load.bodies)

    def drive(self, speed_mps: float, turn_radps: float) -> None:
        """Ask for track motion until the next step."""
        self._speed, self._turn = speed_mps, turn_radps

    def move(self, joints: Joints) -> None:
        """Ask for joint positions; they stay wanted until others are asked for."""
        self._joints = {**self._joints, **joints}

    def hold(self) -> None:
        """Stand still with every joint where it is now."""
        self._speed = self._turn = 0.0
        self._joints = dict(self.telemetry.joints)

    def order(self) -> Order:
        """Return what is wanted now."""
        return Order(self._speed, self._turn, dict(self._joints))
