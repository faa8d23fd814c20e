"""What survives a restart."""

import math
from pathlib import Path

import pytest
from muster_vision.store import MapFile
from muster_vision.tracker import CONFIRM_LOOKS, VANISH_LOOKS, Place, Sighting, Tracker


def rock(x: float, at: float = 1.0) -> Sighting:
    """Return a sighting of a rock."""
    return Sighting("rock", (x, 0.0), ((x, 1.0), (x + 1, 0.0), (x, -1.0)), 2.0, 1.5, math.pi, 0.9, at, at)


def filled() -> Tracker:
    """Return a tracker with rock1, and rock2 gone."""
    tracker = Tracker()
    for _ in range(CONFIRM_LOOKS):
        tracker.look([rock(0), rock(9)], lambda _: Place.BARE, complete=True, now=1.0)
    for _ in range(VANISH_LOOKS):
        tracker.look([rock(0)], lambda _: Place.BARE, complete=True, now=2.0)
    return tracker


def test_the_next_life_goes_on_where_the_last_one_ended(tmp_path: Path) -> None:
    """Names, places, what left, and which numbers were given."""
    before = filled()
    MapFile(tmp_path, "yard").save(before)
    after = MapFile(tmp_path, "yard").load()
    assert [(t.name, t.position) for t in after.named] == [("rock1", (0.0, 0.0))]
    assert after.gone == before.gone
    assert after.numbered
    for _ in range(CONFIRM_LOOKS):
        after.look([rock(0), rock(5)], lambda _: Place.BARE, complete=True, now=3.0)
    assert sorted(t.name or "" for t in after.named) == ["rock1", "rock2"]


def test_without_a_file_the_map_begins_empty(tmp_path: Path) -> None:
    """As on the first day."""
    assert not MapFile(tmp_path / "not there yet", "yard").load().tracks


@pytest.mark.parametrize("junk", [b"", b"{", b'{"format": 99}', b"\x00\xff" * 40])
def test_a_file_that_cannot_be_read_is_kept_aside(tmp_path: Path, junk: bytes) -> None:
    """Vision starts anew, and nothing is lost to whoever wants to look into it."""
    file = MapFile(tmp_path, "yard")
    file.path.write_bytes(junk)
    assert not file.load().tracks
    assert file.path.with_suffix(".unreadable").read_bytes() == junk


def test_what_has_not_changed_is_not_written_again(tmp_path: Path) -> None:
    """When something was last seen changes each second, and is not worth a write."""
    file, tracker = MapFile(tmp_path, "yard"), filled()
    file.save(tracker)
    file.path.unlink()
    tracker.look([rock(0, at=1.0)], lambda _: Place.BARE, complete=True, now=9.0)
    file.save(tracker)
    assert not file.path.exists()
    tracker.look([rock(0.4, at=9.0)], lambda _: Place.BARE, complete=True, now=9.0)
    file.save(tracker)
    assert [p.name for p in tmp_path.iterdir()] == [file.path.name]


def test_two_sites_do_not_share_a_file(tmp_path: Path) -> None:
    """Their names have nothing to do with each other."""
    MapFile(tmp_path, "yard").save(filled())
    assert not MapFile(tmp_path, "quarry").load().tracks
