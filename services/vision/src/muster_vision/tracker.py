"""Which sighting is which object: names stay, go and come back. Pure: looks in, the map out.

A *look* is one processed view. What vanishes and what is merely hidden are told apart by the caller's judgement of the
place (`Place`): only a place that is seen to be bare counts against an object.
"""

import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final

Spot = tuple[float, float]

CONFIRM_LOOKS: Final = 2
"""A new thing is believed after this many looks ..."""
VANISH_LOOKS: Final = 3
"""... and gone after its place was seen bare this many times."""
FORGET_LOOKS: Final = 2
"""A thing not yet believed is dropped after it was missed this many times in a row."""
PATIENCE_LOOKS: Final = 8
"""A new thing waits this long for one alike that is out of sight to turn out gone, so that it gets its name."""
NUMBER_LOOKS: Final = 4
"""The first numbering waits at most this many complete looks for everything in view to be believed."""
RETURN_S: Final = 3600.0
MEASUREMENTS: Final = 5
GATE_M: Final = 1.0


class Place(Enum):
    """What is seen where an object should be, when it was not recognised there."""

    BARE = auto()
    HIDDEN = auto()
    """Something may stand in the way, or no camera looks."""
    UNCLEAR = auto()
    """It is in view, and is neither bare ground nor the object: covered by something else, say."""


@dataclass(frozen=True)
class Sighting:
    """One recognised thing in one look. Metres."""

    object_class: str
    position: Spot
    outline: tuple[Spot, ...]
    length_m: float
    width_m: float
    area_m2: float
    confidence: float
    measured_at: float
    """When the picture behind the geometry was taken; two looks at unchanged ground share it."""
    seen_at: float
    whole: bool = True
    """False if something may cover part of it: then it is there, but its geometry means nothing."""

    @property
    def radius_m(self) -> float:
        """Radius of a circle of its area."""
        return math.sqrt(self.area_m2 / math.pi)


@dataclass
class Track:
    """One object over time."""

    last: Sighting
    """The sighting that its shape is taken from."""
    name: str | None = None
    looks: int = 1
    bare: int = 0
    missed: int = 0
    waited: int = 0
    measured: list[Sighting] = field(default_factory=list[Sighting])
    seen_at: float = 0.0
    confidence: float = 0.0
    hidden: bool = False

    @property
    def object_class(self) -> str:
        """Its class."""
        return self.last.object_class

    @property
    def position(self) -> Spot:
        """Median of the latest measurements."""
        spots = [s.position for s in self.measured] or [self.last.position]
        return statistics.median(x for x, _ in spots), statistics.median(y for _, y in spots)

    @property
    def radius_m(self) -> float:
        """Radius of a circle of its area."""
        return self.last.radius_m

    def take(self, sighting: Sighting, *, measure: bool) -> None:
        """Count a sighting of it; with `measure`, also believe its geometry."""
        self.looks, self.bare, self.missed, self.hidden = self.looks + 1, 0, 0, False
        self.seen_at, self.confidence = sighting.seen_at, sighting.confidence
        known = {s.measured_at for s in self.measured}
        if measure and sighting.measured_at not in known:
            self.measured = [*self.measured, sighting][-MEASUREMENTS:]
            middle = self.position
            # the shape that goes with the median, so that one bad outline is never shown
            self.last = min(reversed(self.measured), key=lambda s: math.dist(s.position, middle))
        elif not self.measured:
            self.last = sighting


@dataclass
class Gone:
    """An object that left the map and may come back."""

    name: str
    object_class: str
    position: Spot
    radius_m: float
    at: float


class Tracker:
    """The objects of a site. `loose` are classes of spread material (soil): what is tipped elsewhere is a new heap."""

    def __init__(self, loose: Iterable[str] = ()) -> None:
        self.loose = frozenset(loose)
        self.tracks: list[Track] = []
        self.gone: list[Gone] = []
        self.highest: dict[str, int] = {}
        self.numbered = False
        """Whether the first numbering has taken place."""
        self._complete_looks = 0

    @property
    def named(self) -> list[Track]:
        """The objects of the map."""
        return [t for t in self.tracks if t.name is not None]

    def look(
        self, sightings: Sequence[Sighting], judge: Callable[[Track], Place], *, complete: bool, now: float
    ) -> None:
        """Take in one look.

        Args:
            sightings: everything that is recognised in the whole view at present.
            judge: says what is seen at the place of a named object that was not recognised.
            complete: every camera of the site has delivered.
            now: the time of the newest picture.

        """
        pairs = _match(self.tracks, sightings)
        for track, sighting in pairs:
            track.take(sighting, measure=self._measures(track, sighting, sightings))
        seen = {id(track) for track, _ in pairs}
        self._miss([t for t in self.tracks if id(t) not in seen], judge, now)
        used = {id(sighting) for _, sighting in pairs}
        for sighting in sightings:
            if id(sighting) not in used and not self._fragment(sighting):
                measured = [sighting] if sighting.whole else []
                self.tracks.append(
                    Track(sighting, measured=measured, seen_at=sighting.seen_at, confidence=sighting.confidence)
                )
        if self.numbered:
            self._name_new(now)
        elif complete:
            self._number_all()

    def _miss(self, tracks: Sequence[Track], judge: Callable[[Track], Place], now: float) -> None:
        for track in tracks:
            track.missed += 1
            if track.name is None:
                if track.missed >= FORGET_LOOKS:
                    self.tracks.remove(track)
                continue
            place = judge(track)
            track.hidden = place is Place.HIDDEN
            track.bare += place is Place.BARE
            if track.bare >= VANISH_LOOKS:
                self.tracks.remove(track)
                self.gone.append(Gone(track.name, track.object_class, track.position, track.radius_m, now))

    def _measures(self, track: Track, sighting: Sighting, all_seen: Sequence[Sighting]) -> bool:
        """Whether a sighting's geometry is to be believed: nothing else lies on the object or beside it in one blob."""
        if not sighting.whole:
            return False
        covered = any(
            other.object_class != track.object_class
            and math.dist(other.position, track.position) < track.radius_m + 0.5 * other.radius_m
            for other in all_seen
        )
        return not covered or not track.measured

    def _fragment(self, sighting: Sighting) -> bool:
        """Whether it is a part of a known object of its class, seen in pieces."""
        return any(
            t.object_class == sighting.object_class and math.dist(t.position, sighting.position) < t.radius_m
            for t in self.tracks
        )

    def _number_all(self) -> None:
        self._complete_looks += 1
        if any(t.looks < CONFIRM_LOOKS for t in self.tracks) and self._complete_looks < NUMBER_LOOKS:
            return
        believed = [t for t in self.tracks if t.looks >= CONFIRM_LOOKS]
        if not believed and self._complete_looks < NUMBER_LOOKS:
            return
        for track in sorted(believed, key=lambda t: t.position):
            track.name = self._next_name(track.object_class)
        self.numbered = True

    def _name_new(self, now: float) -> None:
        for track in sorted((t for t in self.tracks if t.name is None), key=lambda t: t.position):
            if track.looks < CONFIRM_LOOKS or track.missed:
                continue
            back = self._come_back(track, now)
            if back is None and self._one_alike_is_out_of_sight(track) and track.waited < PATIENCE_LOOKS:
                track.waited += 1
                continue
            track.name = back.name if back else self._next_name(track.object_class)
            if back:
                self.gone.remove(back)

    def _come_back(self, track: Track, now: float) -> Gone | None:
        def fits(gone: Gone) -> bool:
            if gone.object_class != track.object_class:
                return False
            if math.dist(gone.position, track.position) < GATE_M:
                return True
            return (
                track.object_class not in self.loose
                and now - gone.at < RETURN_S
                and _alike(gone.radius_m, track.radius_m)
            )

        fitting = [g for g in self.gone if fits(g)]
        return min(fitting, key=lambda g: (math.dist(g.position, track.position) >= GATE_M, -g.at), default=None)

    def _one_alike_is_out_of_sight(self, track: Track) -> bool:
        return track.object_class not in self.loose and any(
            t.object_class == track.object_class and (t.hidden or t.bare) and _alike(t.radius_m, track.radius_m)
            for t in self.named
        )

    def _next_name(self, object_class: str) -> str:
        number = self.highest.get(object_class, 0) + 1
        self.highest[object_class] = number
        return f"{object_class}{number}"


def _alike(first_m: float, second_m: float) -> bool:
    return 0.6 < first_m / max(second_m, 1e-6) < 1.67


def _match(tracks: Sequence[Track], sightings: Sequence[Sighting]) -> list[tuple[Track, Sighting]]:
    """Pair what is of one class and near, nearest first; objects of the map go before things not yet believed."""
    near = [
        (track.name is None, distance, track, sighting)
        for track in tracks
        for sighting in sightings
        if track.object_class == sighting.object_class
        and (distance := math.dist(track.position, sighting.position)) < max(GATE_M, 0.6 * track.radius_m)
    ]
    pairs: list[tuple[Track, Sighting]] = []
    taken: set[int] = set()
    for _, _, track, sighting in sorted(near, key=lambda n: n[:2]):
        if id(track) not in taken and id(sighting) not in taken:
            taken |= {id(track), id(sighting)}
            pairs.append((track, sighting))
    return pairs
