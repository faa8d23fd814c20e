"""The solid or flat things of a site: what they are, where they lie, who carries them."""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

from muster_schemas.base import Pose
from muster_schemas.site import Thing

from .snapshot import BodyState


class Form(Enum):
    """How a thing is built."""

    POOL = "pool"
    """Flat water: machines drive through it."""
    BARRIER = "barrier"
    """A striped block."""
    BOULDER = "boulder"
    PLATE = "plate"
    """Flat, of a class that the simulator does not know."""
    DRUM = "drum"
    """Solid, of a class that the simulator does not know."""


FORMS: Final = {"puddle": Form.POOL, "obstacle": Form.BARRIER, "rock": Form.BOULDER}
SOIL_CLASS: Final = "soil"


def form_of(thing: Thing) -> Form:
    """Return how a thing other than soil is built; an unknown class is solid if it has a height."""
    return FORMS.get(thing.object_class, Form.DRUM if thing.height_m > 0 else Form.PLATE)


@dataclass
class Body:
    """One thing. While a robot carries it (`carrier`), it is not on the ground."""

    name: str
    form: Form
    radius_m: float
    height_m: float
    """Above 0 for solid things; means nothing for flat ones."""
    x: float
    y: float
    yaw: float
    carrier: str | None = None

    @property
    def solid(self) -> bool:
        """Whether machines cannot drive over it, and a bucket can pick it up."""
        return self.form not in (Form.POOL, Form.PLATE)

    @property
    def pose(self) -> Pose:
        """Where it lies (last lay, when carried)."""
        return Pose(x=self.x, y=self.y, yaw=self.yaw)

    def distance(self, x: float, y: float) -> float:
        """Return the distance from its middle to a place on the ground, in metres."""
        return math.hypot(x - self.x, y - self.y)

    def lay(self, x: float, y: float) -> None:
        """Put it back on the ground."""
        self.x, self.y, self.carrier = x, y, None

    def restore(self, state: BodyState) -> None:
        """Be where a snapshot says."""
        self.x, self.y, self.yaw, self.carrier = state.pose.x, state.pose.y, state.pose.yaw, state.carrier
