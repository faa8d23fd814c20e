"""The base of every message, and the geometry that they share. Metres, radians, seconds; x east, y north."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Metres = Annotated[float, Field(ge=-10_000, le=10_000)]
Seconds = Annotated[float, Field(ge=0)]
UnixTime = Annotated[float, Field(ge=0, description="seconds since 1970 (wall clock; never used to order events)")]


class Message(BaseModel):
    """Immutable JSON; unknown fields are ignored so that old and new programs understand each other."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False, extra="ignore", populate_by_name=True)

    def to_json(self) -> bytes:
        """Return the UTF-8 JSON that stands on the bus."""
        return self.model_dump_json(by_alias=True).encode()


class Point(Message):
    """A place on the ground, in metres."""

    x: Metres
    y: Metres

    def distance(self, other: "Point") -> float:
        """Return the distance to `other` in metres."""
        return ((self.x - other.x) ** 2 + (self.y - other.y) ** 2) ** 0.5


class Pose(Point):
    """A place and a heading; yaw in radians, 0 = east, counter-clockwise."""

    yaw: Annotated[float, Field(ge=-100, le=100)] = 0.0
