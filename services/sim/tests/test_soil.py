"""Soil is counted: heaps grow and shrink with their amount, and nothing is lost."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from muster_schemas.base import Point
from muster_sim.soil import Ground, mound_volume


def test_a_pile_begins_as_large_as_its_file_says() -> None:
    """Radius, height and amount of the file hold together."""
    pile = Ground().add_pile("soil1", Point(x=1, y=2), radius_m=2.4, height_m=1.5, soil_m3=12)
    assert pile.radius_m == pytest.approx(2.4)
    assert pile.height_at(1, 2) == pytest.approx(1.5)
    assert pile.soil_m3 == 12


def test_a_pile_without_an_amount_has_what_its_size_holds() -> None:
    """A file that gives only the radius makes a pile of that radius."""
    pile = Ground().add_pile("soil1", Point(x=0, y=0), radius_m=2.0, height_m=0.0, soil_m3=0.0)
    assert pile.soil_m3 == pytest.approx(mound_volume(2.0, 1.2))
    assert pile.radius_m == pytest.approx(2.0)


def test_a_pile_shrinks_as_soil_is_taken() -> None:
    """An eighth of the amount is half the size."""
    ground = Ground()
    pile = ground.add_pile("soil1", Point(x=0, y=0), radius_m=2.4, height_m=1.5, soil_m3=8)
    assert ground.take(0.5, 0, 7) == 7
    assert pile.radius_m == pytest.approx(1.2)
    assert pile.height_m == pytest.approx(0.75)


def test_no_more_is_taken_than_there_is() -> None:
    """The last of a pile is less than a bucket, then the pile is gone."""
    ground = Ground()
    ground.add_pile("soil1", Point(x=0, y=0), radius_m=1.0, height_m=0.5, soil_m3=0.3)
    assert ground.take(0, 0, 0.5) == pytest.approx(0.3)
    assert list(ground) == []
    assert ground.dug_m3 == 0


def test_level_ground_gives_all_that_is_asked_for() -> None:
    """Beside the heaps the ground itself is dug, and that is counted."""
    ground = Ground()
    assert ground.take(5, 5, 0.5) == 0.5
    assert ground.dug_m3 == 0.5


def test_soil_that_falls_on_a_heap_joins_it() -> None:
    """Within its edge it is the same heap, beyond it a new one."""
    ground = Ground()
    first = ground.drop(0, 0, 1.0)
    assert ground.drop(0.9 * first.radius_m, 0, 0.5) is first
    assert ground.drop(5, 0, 0.5) is not first
    assert [h.soil_m3 for h in ground] == [1.5, 0.5]


def test_soil_on_a_pile_stays_that_pile() -> None:
    """The truth still names the pile."""
    ground = Ground()
    ground.add_pile("soil1", Point(x=0, y=0), radius_m=2.0, height_m=1.0, soil_m3=6)
    ground.drop(1, 1, 0.5)
    assert [(d.pile, d.soil_m3) for d in ground.deposits()] == [("soil1", 6.5)]


_places = st.floats(-4, 4)


@given(st.lists(st.tuples(st.booleans(), _places, _places, st.floats(0.001, 2))))
def test_soil_is_conserved(moves: list[tuple[bool, float, float, float]]) -> None:
    """Whatever is dug and dropped, heaps and load together keep what was not dug out of the ground."""
    ground = Ground()
    ground.add_pile("soil1", Point(x=0, y=0), radius_m=2.0, height_m=1.0, soil_m3=6)
    load = 0.0
    for take, x, y, amount in moves:
        if take:
            load += ground.take(x, y, amount)
        elif load > 0:
            fallen = min(load, amount)
            ground.drop(x, y, fallen)
            load -= fallen
        assert all(h.soil_m3 > 0 and math.isfinite(h.radius_m) for h in ground)
    assert ground.heaped_m3 + load - ground.dug_m3 == pytest.approx(6, abs=1e-4)
