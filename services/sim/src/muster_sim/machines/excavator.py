"""A crawler excavator (dimensions and kinematics: `muster_schemas.machines.EXCAVATOR`)."""

from collections.abc import Sequence
from enum import Enum

from muster_schemas.machines import EXCAVATOR
from muster_schemas.site import RobotEntry, RobotType

from muster_sim.scene import Colour, Link, Part, Vector
from muster_sim.snapshot import MachineState

from .base import Machine, tracks

PAINT: Colour = (0.95, 0.72, 0.08)
SHADE: Colour = (0.82, 0.60, 0.06)
DARK: Colour = (0.20, 0.20, 0.21)
GLASS: Colour = (0.16, 0.20, 0.24)
PITCH: Vector = (0.0, -1.0, 0.0)
REST = {"swing": 0.0, "boom": 0.8, "arm": -2.2, "bucket": -1.2}


class Grip(Enum):
    """What the bucket does."""

    HOLDS = "holds"
    OPEN = "open"
    CURLS = "curls"


class Excavator(Machine):
    """Swings, reaches, digs."""

    joint_limits = EXCAVATOR.joints

    def __init__(self, entry: RobotEntry, kind: RobotType, command_timeout_s: float) -> None:
        super().__init__(entry, kind, command_timeout_s, REST)
        self.grip = Grip.HOLDS

    def restore(self, state: MachineState) -> None:
        """Stand as a snapshot says; a curl that was under way has to be begun again."""
        super().restore(state)
        self.grip = Grip.HOLDS
        self.update_grip()

    def update_grip(self) -> Grip | None:
        """Follow the bucket's joint and return what it has newly become, or None.

        A bucket that was open curls until it holds; curled half and opened again, it has dug nothing.
        """
        angle, before = self.joints["bucket"], self.grip
        if angle > EXCAVATOR.releases_above_rad:
            self.grip = Grip.OPEN
        elif angle <= EXCAVATOR.holds_below_rad:
            self.grip = Grip.HOLDS
        elif before is Grip.OPEN:
            self.grip = Grip.CURLS
        return self.grip if self.grip is not before else None

    def tip(self) -> Vector:
        """Return the bucket's tip on the site, in metres."""
        forward, up = EXCAVATOR.bucket_tip(self.joints["boom"], self.joints["arm"], self.joints["bucket"])
        return (*self.place(forward, turned=self.joints["swing"]), up)

    def bucket_centre(self) -> Vector:
        """Return the middle of the bucket on the site: what falls out falls from there."""
        boom, arm = self.joints["boom"], self.joints["arm"]
        tip, joint = EXCAVATOR.bucket_tip(boom, arm, self.joints["bucket"]), EXCAVATOR.bucket_joint(boom, arm)
        return (*self.place((tip[0] + joint[0]) / 2, turned=self.joints["swing"]), (tip[1] + joint[1]) / 2)

    @property
    def base(self) -> Sequence[Part]:
        """The tracks."""
        return (
            *tracks(self.kind.length_m, self.kind.width_m, height=0.75),
            Part((1.3, 1.3, 0.3), (0, 0, 0.8), DARK),
        )

    @property
    def links(self) -> Sequence[Link]:
        """Upper body, boom, arm, bucket."""
        boom, arm, bucket = EXCAVATOR.boom_m, EXCAVATOR.arm_m, EXCAVATOR.bucket_m
        foot = (EXCAVATOR.boom_foot_x_m, 0.0, EXCAVATOR.boom_foot_z_m)
        house = (
            Part((2.3, 2.3, 0.9), (-0.45, 0, 1.35), PAINT),
            Part((0.55, 2.2, 0.85), (-1.6, 0, 1.4), DARK),
            Part((1.3, 0.85, 1.3), (0.35, 0.72, 1.75), PAINT),
            Part((1.05, 0.65, 0.04), (0.35, 0.72, 2.41), (0.93, 0.9, 0.8)),
            Part((0.06, 0.75, 0.9), (1.0, 0.72, 1.8), GLASS),
            Part((0.9, 0.9, 0.08), (-0.7, -0.4, 1.83), SHADE),
        )
        boom_parts = (
            Part((boom * 0.55, 0.34, 0.5), (boom * 0.26, 0, 0.14), PAINT, pitch=0.16),
            Part((boom * 0.55, 0.32, 0.42), (boom * 0.74, 0, 0.15), PAINT, pitch=-0.17),
            Part((1.3, 0.14, 0.14), (boom * 0.62, 0, 0.5), (0.6, 0.6, 0.62), pitch=-0.1),
        )
        arm_parts = (
            Part((arm, 0.28, 0.34), (arm / 2, 0, 0.05), PAINT),
            Part((1.0, 0.12, 0.12), (arm * 0.45, 0, 0.32), (0.6, 0.6, 0.62)),
        )
        # the bucket opens towards the machine (down when level): its back is the wall away from it
        bucket_parts = (
            Part((bucket * 0.95, 0.95, 0.1), (bucket * 0.5, 0, 0.3), DARK, pitch=-0.25),
            Part((bucket * 0.7, 0.08, 0.5), (bucket * 0.45, 0.44, 0.05), DARK),
            Part((bucket * 0.7, 0.08, 0.5), (bucket * 0.45, -0.44, 0.05), DARK),
            Part((0.16, 0.9, 0.08), (bucket * 0.94, 0, 0.08), (0.55, 0.55, 0.55), pitch=-0.6),
        )
        return (
            Link(0, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), house),
            Link(1, foot, PITCH, boom_parts),
            Link(2, (boom, 0.0, 0.0), PITCH, arm_parts),
            Link(3, (arm, 0.0, 0.0), PITCH, bucket_parts),
        )
