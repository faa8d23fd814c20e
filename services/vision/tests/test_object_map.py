"""What goes onto the bus, and when."""

import math
from dataclasses import replace

import pytest
from muster_schemas.world import MapObject
from muster_vision.object_map import REFRESH_S, ObjectMap, message
from muster_vision.tracker import CONFIRM_LOOKS, VANISH_LOOKS, Place, Sighting, Track, Tracker

ROCK = Sighting("rock", (3.0, 4.0), ((3.0, 5.0), (4.0, 4.0), (3.0, 3.0)), 2.0, 1.5, math.pi, 0.9, 10.0, 10.0)


class Spoken:
    """A map whose words are written down."""

    def __init__(self) -> None:
        self.published: list[MapObject] = []
        self.retracted: list[str] = []
        self.map = ObjectMap(self.published.append, self.retracted.append)
        self.tracker = Tracker()

    def look(self, *sightings: Sighting, times: int = 1, now: float = 0.0) -> None:
        """Take in looks, and say what is to say."""
        for _ in range(times):
            self.tracker.look(sightings, lambda _: Place.BARE, complete=True, now=now)
            self.map.update(self.tracker, now)


def test_an_object_is_told_once_and_not_again_while_nothing_changes() -> None:
    """Looks come each second, words only when there is something to say."""
    said = Spoken()
    said.look(ROCK, times=CONFIRM_LOOKS + 5)
    assert [o.name for o in said.published] == ["rock1"]


def test_it_is_told_again_after_a_while_with_the_time_it_was_last_seen() -> None:
    """So that a reader can tell a quiet site from a dead camera."""
    said = Spoken()
    said.look(ROCK, times=CONFIRM_LOOKS)
    said.look(replace(ROCK, seen_at=14.0), now=REFRESH_S)
    assert [o.seen_at for o in said.published] == [10.0, 14.0]


def test_an_object_that_moved_is_told_at_once() -> None:
    """A hand's breadth is enough."""
    said = Spoken()
    said.look(ROCK, times=CONFIRM_LOOKS)
    said.look(replace(ROCK, position=(3.3, 4.0), measured_at=11.0))
    assert said.published[-1].position.x == pytest.approx(3.15)


def test_an_object_that_left_is_retracted_once() -> None:
    """And forgotten."""
    said = Spoken()
    said.look(ROCK, times=CONFIRM_LOOKS)
    said.look(times=VANISH_LOOKS + 5)
    assert said.retracted == ["rock1"]


def test_the_outline_moves_with_the_position() -> None:
    """The published centre is the median; the shape belongs to one measurement."""
    track = Track(ROCK, name="rock1", measured=[ROCK, replace(ROCK, position=(3.2, 4.0), measured_at=11.0)])
    told = message(track)
    assert told.position.x == pytest.approx(3.1)
    assert told.shape[1].x == pytest.approx(4.1)


def test_something_without_a_name_is_no_message() -> None:
    """It would have no key."""
    with pytest.raises(ValueError, match="name"):
        message(Track(ROCK))
