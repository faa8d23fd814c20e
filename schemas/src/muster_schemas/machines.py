"""Dimensions and joints of the machines: what the simulator builds and what an agent's kinematics count on.

Robot frame: origin on the ground in the middle of the tracks, x forward, y left, z up. Sizes follow a Hitachi ZX120
and a Yanmar C30R, rounded.
"""

import math
from typing import Final

from .base import Message


class JointLimit(Message):
    """Range (rad) and speed (rad/s) of a joint."""

    low: float
    high: float
    speed_radps: float


class Excavator(Message):
    """An upper body that swings, and boom, arm and bucket in its vertical plane.

    `swing` is the yaw of the upper body against the tracks. `boom` is the boom's pitch above the horizon; `arm` and
    `bucket` are pitches against the link before, so a link's own pitch is the sum up to it. Zero everywhere is a
    straight arm that points forward.
    """

    boom_foot_x_m: float = 0.3
    boom_foot_z_m: float = 1.3
    boom_m: float = 3.9
    arm_m: float = 2.3
    bucket_m: float = 1.0
    joints: dict[str, JointLimit] = {  # noqa: RUF012  (pydantic copies it)
        "swing": JointLimit(low=-math.pi, high=math.pi, speed_radps=0.9),
        "boom": JointLimit(low=-0.7, high=1.2, speed_radps=0.6),
        "arm": JointLimit(low=-2.6, high=-0.3, speed_radps=0.8),
        "bucket": JointLimit(low=-2.2, high=0.6, speed_radps=1.2),
    }
    holds_below_rad: float = -1.0
    """A bucket joint at or below this keeps what is in it ..."""
    releases_above_rad: float = -0.5
    """... and above this lets it fall. Curling from the second to the first while the tip is in soil fills it."""

    def bucket_tip(self, boom: float, arm: float, bucket: float) -> tuple[float, float]:
        """Return (forward, up) of the bucket's tip in metres, in the plane of the upper body."""
        forward, up = self.bucket_joint(boom, arm)
        pitch = boom + arm + bucket
        return forward + self.bucket_m * math.cos(pitch), up + self.bucket_m * math.sin(pitch)

    def bucket_joint(self, boom: float, arm: float) -> tuple[float, float]:
        """Return (forward, up) of the bucket's pivot in metres, in the plane of the upper body."""
        return (
            self.boom_foot_x_m + self.boom_m * math.cos(boom) + self.arm_m * math.cos(boom + arm),
            self.boom_foot_z_m + self.boom_m * math.sin(boom) + self.arm_m * math.sin(boom + arm),
        )


class DumpTruck(Message):
    """A tracked carrier whose bed tips backwards about its rear edge. `bed` is 0 when level."""

    bed_length_m: float = 2.4
    bed_width_m: float = 1.9
    bed_floor_z_m: float = 1.0
    bed_wall_m: float = 0.4
    bed_centre_x_m: float = -0.3
    joints: dict[str, JointLimit] = {  # noqa: RUF012  (pydantic copies it)
        "bed": JointLimit(low=0.0, high=1.1, speed_radps=0.35)
    }
    empties_above_rad: float = 0.6
    """Above this everything slides out, onto the ground at `drop_x_m`."""
    drop_x_m: float = -2.4


EXCAVATOR: Final = Excavator()
DUMP_TRUCK: Final = DumpTruck()
