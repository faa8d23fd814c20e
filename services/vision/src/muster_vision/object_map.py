"""The tracker's objects as messages: published when they change, refreshed while they are seen, retracted when gone."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from muster_schemas.base import Point
from muster_schemas.world import MapObject, ObjectSize

from .tracker import Track, Tracker

REFRESH_S = 5.0
MOVED_M = 0.05
GREW_M = 0.1


@dataclass(frozen=True)
class _Sent:
    message: MapObject
    at: float


class ObjectMap:
    """What was last said about each object."""

    def __init__(self, publish: Callable[[MapObject], None], retract: Callable[[str], None]) -> None:
        self._publish = publish
        self._retract = retract
        self._sent: dict[str, _Sent] = {}

    def update(self, tracker: Tracker, now: float) -> None:
        """Say what is new: objects that came, moved, grew or left, and the rest every `REFRESH_S` (monotonic `now`)."""
        messages = {m.name: m for m in map(message, tracker.named)}
        for name in set(self._sent) - set(messages):
            self._retract(name)
            del self._sent[name]
        for name, new in messages.items():
            old = self._sent.get(name)
            if old is None or _changed(old.message, new) or now - old.at >= REFRESH_S:
                self._publish(new)
                self._sent[name] = _Sent(new, now)


def message(track: Track) -> MapObject:
    """Return what the bus is told about an object of the map."""
    if track.name is None:
        raise ValueError("only objects that have a name are in the map")
    x, y = track.position
    # the outline of the measurement nearest to the median, moved onto the median
    dx, dy = x - track.last.position[0], y - track.last.position[1]
    return MapObject.model_validate(
        {
            "name": track.name,
            "class": track.object_class,
            "position": Point(x=round(x, 3), y=round(y, 3)),
            "shape": tuple(Point(x=round(px + dx, 3), y=round(py + dy, 3)) for px, py in track.last.outline),
            "size": ObjectSize(length_m=round(track.last.length_m, 3), width_m=round(track.last.width_m, 3)),
            "confidence": round(min(1.0, max(0.0, track.confidence)), 3),
            "seen_at": track.seen_at,
        }
    )


def _changed(old: MapObject, new: MapObject) -> bool:
    return (
        old.object_class != new.object_class
        or old.position.distance(new.position) > MOVED_M
        or abs(old.size.length_m - new.size.length_m) > GREW_M
        or abs(old.size.width_m - new.size.width_m) > GREW_M
        or not math.isclose(old.confidence, new.confidence, abs_tol=0.2)
    )
