"""Names stay, go and come back."""

import math
from collections.abc import Sequence

import pytest
from muster_vision.tracker import (
    CONFIRM_LOOKS,
    PATIENCE_LOOKS,
    RETURN_S,
    VANISH_LOOKS,
    Place,
    Sighting,
    Track,
    Tracker,
)


def seen(
    object_class: str, x: float, y: float = 0.0, *, radius: float = 1.0, at: float = 0.0, whole: bool = True
) -> Sighting:
    """Return a sighting of something round."""
    return Sighting(
        object_class=object_class,
        position=(x, y),
        outline=tuple((x + radius * math.cos(a), y + radius * math.sin(a)) for a in (0, 1.6, 3.1, 4.7)),
        length_m=2 * radius,
        width_m=2 * radius,
        area_m2=math.pi * radius**2,
        confidence=0.9,
        measured_at=at,
        seen_at=at,
        whole=whole,
    )


class Looker:
    """Gives a tracker looks, a second apart; `places` says what is seen where objects were not recognised."""

    def __init__(self, tracker: Tracker | None = None) -> None:
        self.tracker = tracker or Tracker(loose=["soil"])
        self.now = 0.0
        self.places: dict[str, Place] = {}

    def look(self, *sightings: Sighting, times: int = 1, complete: bool = True) -> None:
        """Let a second pass and take in a look, several times."""
        for _ in range(times):
            self.now += 1.0
            self.tracker.look(sightings, self._judge, complete=complete, now=self.now)

    def _judge(self, track: Track) -> Place:
        return self.places.get(track.name or "", Place.BARE)

    @property
    def names(self) -> dict[str, float]:
        """The objects' names, with their x rounded to a metre."""
        return {t.name or "": round(t.position[0]) for t in self.tracker.named}


def settled(*sightings: Sighting) -> Looker:
    """Return a tracker for which these are the objects of the map."""
    looker = Looker()
    looker.look(*sightings, times=CONFIRM_LOOKS)
    assert len(looker.names) == len(sightings)
    return looker


def test_numbers_of_a_class_go_from_west_to_east() -> None:
    """In whatever order they are seen."""
    looker = settled(seen("puddle", 9), seen("rock", 0), seen("puddle", -4), seen("puddle", 3))
    assert looker.names == {"puddle1": -4, "puddle2": 3, "puddle3": 9, "rock1": 0}


def test_nothing_is_numbered_before_every_camera_has_delivered() -> None:
    """Else the first camera's objects would take the low numbers."""
    looker = Looker()
    looker.look(seen("puddle", 9), times=5, complete=False)
    assert not looker.names
    looker.look(seen("puddle", 9), seen("puddle", -4), times=CONFIRM_LOOKS)
    assert looker.names == {"puddle1": -4, "puddle2": 9}


def test_what_is_seen_only_once_gets_no_name() -> None:
    """A flicker is no object."""
    looker = settled(seen("rock", 0))
    looker.look(seen("rock", 0), seen("puddle", 5))
    looker.look(seen("rock", 0), times=5)
    assert looker.names == {"rock1": 0}
    assert len(looker.tracker.tracks) == 1


def test_later_things_get_the_next_number_wherever_they_lie() -> None:
    """Even west of all others."""
    looker = settled(seen("puddle", 0), seen("puddle", 5))
    looker.look(seen("puddle", 0), seen("puddle", 5), seen("puddle", -9), times=CONFIRM_LOOKS)
    assert looker.names == {"puddle1": 0, "puddle2": 5, "puddle3": -9}


def test_a_number_is_never_given_to_another_thing() -> None:
    """Soil that was dug away leaves its number unused."""
    looker = settled(seen("soil", 0), seen("soil", 5))
    looker.look(seen("soil", 0), times=VANISH_LOOKS)
    looker.look(seen("soil", 0), seen("soil", 20), times=CONFIRM_LOOKS)
    assert looker.names == {"soil1": 0, "soil3": 20}


def test_a_thing_leaves_the_map_once_its_place_was_seen_bare_several_times() -> None:
    """Not before."""
    looker = settled(seen("obstacle", 0))
    looker.look(times=VANISH_LOOKS - 1)
    assert looker.names
    looker.look()
    assert not looker.names


@pytest.mark.parametrize("place", [Place.HIDDEN, Place.UNCLEAR])
def test_a_thing_that_is_merely_out_of_sight_stays(place: Place) -> None:
    """However long a robot stands before it, or something covers it."""
    looker = settled(seen("puddle", 0))
    looker.places["puddle1"] = place
    looker.look(times=50)
    assert looker.names == {"puddle1": 0}


def test_being_seen_again_clears_what_spoke_against_a_thing() -> None:
    """Bare looks count only without a sighting between."""
    looker = settled(seen("obstacle", 0))
    for _ in range(5):
        looker.look(times=VANISH_LOOKS - 1)
        looker.look(seen("obstacle", 0))
    assert looker.names == {"obstacle1": 0}


def test_a_thing_put_down_elsewhere_becomes_itself_again() -> None:
    """It was picked up, left the map, and comes back under its name."""
    looker = settled(seen("obstacle", 0), seen("obstacle", 9))
    looker.look(seen("obstacle", 9), times=VANISH_LOOKS)
    assert looker.names == {"obstacle2": 9}
    looker.look(seen("obstacle", 9), seen("obstacle", 5), times=CONFIRM_LOOKS)
    assert looker.names == {"obstacle1": 5, "obstacle2": 9}


def test_it_is_itself_again_even_if_it_is_put_down_before_its_old_place_is_seen() -> None:
    """The excavator still hides where it was; then that place turns out bare."""
    looker = settled(seen("obstacle", 0))
    looker.places["obstacle1"] = Place.HIDDEN
    looker.look(seen("obstacle", 5), times=CONFIRM_LOOKS + 1)
    assert looker.names == {"obstacle1": 0}
    looker.places["obstacle1"] = Place.BARE
    looker.look(seen("obstacle", 5), times=VANISH_LOOKS + 1)
    assert looker.names == {"obstacle1": 5}


def test_a_new_thing_is_not_kept_waiting_for_ever() -> None:
    """When the one alike stays hidden, it gets its own number."""
    looker = settled(seen("obstacle", 0))
    looker.places["obstacle1"] = Place.HIDDEN
    looker.look(seen("obstacle", 5), times=CONFIRM_LOOKS + PATIENCE_LOOKS + 1)
    assert looker.names == {"obstacle1": 0, "obstacle2": 5}


def test_a_thing_of_quite_another_size_is_another_thing() -> None:
    """A boulder does not come back as a pebble."""
    looker = settled(seen("rock", 0, radius=1.5))
    looker.look(times=VANISH_LOOKS)
    looker.look(seen("rock", 5, radius=0.5), times=CONFIRM_LOOKS)
    assert looker.names == {"rock2": 5}


def test_after_long_it_is_another_thing() -> None:
    """Nobody would still say that it is the same."""
    looker = settled(seen("rock", 0))
    looker.look(times=VANISH_LOOKS)
    looker.now += RETURN_S
    looker.look(seen("rock", 5), times=CONFIRM_LOOKS)
    assert looker.names == {"rock2": 5}


def test_soil_that_is_tipped_elsewhere_is_a_new_heap() -> None:
    """Also when a pile of that size was dug away just before."""
    looker = settled(seen("soil", 0), seen("soil", 9))
    looker.look(seen("soil", 9), times=VANISH_LOOKS)
    looker.look(seen("soil", 9), seen("soil", 4), times=CONFIRM_LOOKS)
    assert looker.names == {"soil2": 9, "soil3": 4}


def test_what_was_wrongly_given_up_gets_its_name_back_at_its_place() -> None:
    """Soil, too."""
    looker = settled(seen("soil", 0))
    looker.look(times=VANISH_LOOKS)
    looker.look(seen("soil", 0.3), times=CONFIRM_LOOKS)
    assert looker.names == {"soil1": 0}


def test_a_load_tipped_onto_a_puddle_leaves_the_puddle_in_the_map_and_in_its_place() -> None:
    """The heap gets a name of its own; what is still seen of the puddle does not move it."""
    looker = settled(seen("puddle", 0, radius=2.2))
    rest = seen("puddle", 0.8, radius=1.6, at=9.0)
    looker.look(rest, seen("soil", -1, radius=1.0, at=9.0), times=CONFIRM_LOOKS + 2)
    assert looker.names == {"puddle1": 0, "soil1": -1}
    looker.places["puddle1"] = Place.UNCLEAR
    looker.look(seen("soil", 0, radius=2.4, at=12.0), times=20)
    assert looker.names["puddle1"] == 0


def test_a_position_is_the_median_of_measurements() -> None:
    """One that is far off moves nothing."""
    looker = settled(seen("rock", 0))
    for time, x in enumerate((0.0, 0.05, 0.9, 0.02, 0.03)):
        looker.look(seen("rock", x, at=10.0 + time))
    (track,) = looker.tracker.named
    assert track.position[0] == pytest.approx(0.03)
    assert track.last.position[0] < 0.1


def test_looking_again_at_the_same_picture_is_no_new_measurement() -> None:
    """Else the first picture of a quiet site would outvote every later one."""
    looker = settled(seen("rock", 0, at=1.0))
    looker.look(seen("rock", 0, at=1.0), times=10)
    assert len(looker.tracker.named[0].measured) == 1


def test_a_thing_that_something_may_cover_in_part_keeps_its_geometry() -> None:
    """It counts as seen, though."""
    looker = settled(seen("soil", 0, radius=2.0))
    looker.look(seen("soil", 0.9, radius=1.0, at=33.0, whole=False), times=3)
    (track,) = looker.tracker.named
    assert track.position == (0.0, 0.0)
    assert track.radius_m == pytest.approx(2.0)
    assert track.seen_at == 33.0


def test_pieces_of_a_known_thing_are_not_new_things() -> None:
    """An arm over a pile may cut its picture in two."""
    looker = settled(seen("soil", 0, radius=2.4))
    halves: Sequence[Sighting] = (
        seen("soil", -1.2, radius=0.8, at=5.0, whole=False),
        seen("soil", 1.2, radius=0.8, at=5.0, whole=False),
    )
    looker.look(*halves, times=10)
    assert looker.names == {"soil1": 0}
