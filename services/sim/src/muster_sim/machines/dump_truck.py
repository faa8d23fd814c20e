"""A tracked dump truck whose bed tips backwards (dimensions: `muster_schemas.machines.DUMP_TRUCK`)."""

import math
from collections.abc import Sequence

from muster_schemas.machines import DUMP_TRUCK
from muster_schemas.site import RobotEntry, RobotType

from muster_sim.scene import Colour, Link, Part

from .base import Machine, tracks

PAINT: Colour = (0.10, 0.42, 0.30)
BED_PAINT: Colour = (0.16, 0.50, 0.38)
GLASS: Colour = (0.16, 0.20, 0.24)


class DumpTruck(Machine):
    """Takes what falls into its bed and drops it behind when the bed is tipped."""

    joint_limits = DUMP_TRUCK.joints

    def __init__(self, entry: RobotEntry, kind: RobotType, command_timeout_s: float) -> None:
        super().__init__(entry, kind, command_timeout_s, {"bed": 0.0})

    @property
    def tipped(self) -> bool:
        """Whether the bed is too steep to hold anything."""
        return self.joints["bed"] > DUMP_TRUCK.empties_above_rad

    @property
    def drop_point(self) -> tuple[float, float]:
        """Where on the site its load lands."""
        return self.place(DUMP_TRUCK.drop_x_m)

    def under(self, x: float, y: float, z: float) -> bool:
        """Whether something that falls from there falls into the bed."""
        east, north = x - self.x, y - self.y
        forward = east * math.cos(self.yaw) + north * math.sin(self.yaw)
        left = north * math.cos(self.yaw) - east * math.sin(self.yaw)
        return (
            abs(forward - DUMP_TRUCK.bed_centre_x_m) <= DUMP_TRUCK.bed_length_m / 2
            and abs(left) <= DUMP_TRUCK.bed_width_m / 2
            and z > DUMP_TRUCK.bed_floor_z_m
        )

    @property
    def base(self) -> Sequence[Part]:
        """Tracks, frame and the cab in front."""
        length, width = self.kind.length_m, self.kind.width_m
        front = length / 2
        return (
            *tracks(length, width, height=0.6),
            Part((length * 0.95, width * 0.5, 0.35), (0, 0, 0.72), (0.22, 0.22, 0.24)),
            Part((0.75, width * 0.9, 1.0), (front - 0.4, 0, 1.15), PAINT),
            Part((0.55, width * 0.42, 0.55), (front - 0.42, width * 0.2, 1.9), PAINT),
            Part((0.06, width * 0.38, 0.4), (front - 0.13, width * 0.2, 1.9), GLASS),
            Part((0.45, width * 0.34, 0.04), (front - 0.42, width * 0.2, 2.19), (0.92, 0.93, 0.9)),
        )

    @property
    def links(self) -> Sequence[Link]:
        """The bed, hinged at its rear edge."""
        length, width, wall = DUMP_TRUCK.bed_length_m, DUMP_TRUCK.bed_width_m, DUMP_TRUCK.bed_wall_m
        hinge = (DUMP_TRUCK.bed_centre_x_m - length / 2, 0.0, DUMP_TRUCK.bed_floor_z_m)
        thick, middle = 0.1, length / 2
        parts = (
            Part((length, width, 0.1), (middle, 0, -0.05), (0.42, 0.44, 0.44)),
            Part((length, thick, wall), (middle, (width - thick) / 2, wall / 2), BED_PAINT),
            Part((length, thick, wall), (middle, (thick - width) / 2, wall / 2), BED_PAINT),
            Part((thick, width, wall * 1.4), (length - thick / 2, 0, wall * 0.7), BED_PAINT),
            Part((thick, width, wall * 0.5), (thick / 2, 0, wall * 0.25), BED_PAINT),
        )
        return (Link(0, hinge, (0.0, -1.0, 0.0), parts),)
