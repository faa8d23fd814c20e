"""The demo's judgement of where the soil is."""

from muster_cli.demo import Soil

BEFORE = Soil(pile=12.0, truck=0.0, puddle=0.0)


def test_soil_at_the_puddle_is_right() -> None:
    """What the pile lost lies at the puddle."""
    assert Soil(pile=11.6, truck=0.0, puddle=0.4).problems(BEFORE) == []


def test_soil_left_in_the_truck_is_wrong() -> None:
    """A truck that did not tip is told."""
    problems = Soil(pile=11.6, truck=0.4, puddle=0.0).problems(BEFORE)
    assert any("truck" in p for p in problems)
    assert any("puddle" in p for p in problems)


def test_soil_that_was_lost_on_the_way_is_wrong() -> None:
    """The pile must not lose more than the puddle gets."""
    assert len(Soil(pile=11.4, truck=0.0, puddle=0.3).problems(BEFORE)) == 1


def test_nothing_done_is_wrong() -> None:
    """A mission that moved nothing is told."""
    assert BEFORE.problems(BEFORE) != []
