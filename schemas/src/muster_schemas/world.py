"""What the site knows about its ground: the object map, wanted keywords, area rules, camera frames."""

from typing import Annotated

from pydantic import Field

from .base import Message, Point, Seconds, UnixTime
from .ids import Id


class ObjectSize(Message):
    """Extent along and across its longer axis, in metres."""

    length_m: float = Field(ge=0, le=10_000)
    width_m: float = Field(ge=0, le=10_000)


class MapObject(Message):
    """One thing on the ground, as the cameras see it. It leaves the map by a delete on its key."""

    name: Id
    object_class: str = Field(alias="class", max_length=64, description="such as 'puddle', 'soil', 'obstacle', 'rock'")
    position: Point
    shape: Annotated[tuple[Point, ...], Field(max_length=256)] = Field(default=(), description="outline, in metres")
    size: ObjectSize
    confidence: float = Field(ge=0, le=1)
    seen_at: UnixTime

    @property
    def radius_m(self) -> float:
        """Radius of the circle around `position` that holds it."""
        if self.shape:
            return max(self.position.distance(p) for p in self.shape)
        return max(self.size.length_m, self.size.width_m) / 2


class Keywords(Message):
    """What to look for now, beside what the site always looks for."""

    keywords: Annotated[tuple[Annotated[str, Field(min_length=1, max_length=64)], ...], Field(max_length=64)]
    asked_by: Id
    for_s: Seconds = Field(default=10.0, le=3600, description="how long the wish holds")


class AreaRule(Message):
    """One robot keeps out of one circle."""

    robot_id: Id
    object_name: Id
    centre: Point
    radius_m: float = Field(gt=0, le=1000, description="of the area itself; the robot adds its own size")


class AreaRules(Message):
    """All rules that hold; a higher revision replaces a lower one."""

    revision: int = Field(ge=0)
    rules: tuple[AreaRule, ...] = ()

    def avoided_by(self, robot_id: str) -> tuple[AreaRule, ...]:
        """Return the rules of one robot."""
        return tuple(r for r in self.rules if r.robot_id == robot_id)


class CameraFrame(Message):
    """The attachment of a JPEG: a pinhole camera without distortion.

    `orientation` is the quaternion (x, y, z, w) that turns camera axes (x right, y down, z forward) into the site's
    (x east, y north, z up).
    """

    camera_id: Id
    seq: int = Field(ge=0)
    taken_at: UnixTime
    width_px: int = Field(ge=1, le=8192)
    height_px: int = Field(ge=1, le=8192)
    fx_px: float = Field(gt=0)
    fy_px: float = Field(gt=0)
    cx_px: float
    cy_px: float
    x_m: float
    y_m: float
    z_m: float = Field(gt=0)
    orientation: tuple[float, float, float, float]
