"""A robot that only drives: a flat tracked platform with a mast, for any type that is no excavator or dump truck."""

from collections.abc import Sequence

from muster_schemas.site import RobotEntry, RobotType

from muster_sim.scene import Link, Part

from .base import Machine, tracks


class Carrier(Machine):
    """Has no joints and takes no load."""

    def __init__(self, entry: RobotEntry, kind: RobotType, command_timeout_s: float) -> None:
        super().__init__(entry, kind, command_timeout_s, {})

    @property
    def base(self) -> Sequence[Part]:
        """A white deck on tracks with a sensor mast in front."""
        length, width = self.kind.length_m, self.kind.width_m
        high = min(0.5, 0.3 * width)
        return (
            *tracks(length, width, height=high),
            Part((length * 0.92, width * 0.8, high * 0.5), (0, 0, high * 1.2), (0.86, 0.87, 0.9)),
            Part((length * 0.18, width * 0.3, high * 1.2), (length * 0.28, 0, high * 2.0), (0.35, 0.25, 0.55)),
        )

    @property
    def links(self) -> Sequence[Link]:
        """None."""
        return ()
