"""Loads are physical: what is dug, where it falls, and who has it then."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from muster_schemas.site import Site
from muster_sim.testing import AHEAD_M, CLOSED, DEEP, OPEN, READY, Operator, small_site
from muster_sim.world import World

SOIL = {"name": "soil1", "class": "soil", "position": {"x": 5, "y": 0}, "radius_m": 2.4, "height_m": 1.5, "soil_m3": 12}
ROCK = {"name": "rock1", "class": "rock", "position": {"x": 5, "y": 0}, "radius_m": 0.8, "height_m": 0.8}
OBSTACLE = {**ROCK, "name": "obstacle1", "class": "obstacle"}
PUDDLE = {"name": "puddle1", "class": "puddle", "position": {"x": 5, "y": 0}, "radius_m": 2.2}
BESIDE = math.pi / 2
"""Where the truck's bed is, as the excavator's swing."""
ROBOTS = {"digger": ("excavator", 0.0, 0.0, 0.0), "truck": ("dump_truck", 0.3, AHEAD_M, 0.0)}


def pit(*things: Mapping[str, Any]) -> Site:
    """Return a site where the excavator has the things 5 m ahead and a truck's bed to its left."""
    return small_site(ROBOTS, things)


@pytest.fixture
def operator() -> Iterator[Operator]:
    """Return an operator at a soil pile."""
    with World(pit(SOIL)) as world:
        yield Operator(world)


def load(operator: Operator, robot_id: str) -> float:
    """Return the soil that a robot has, in m3."""
    return operator.world.telemetry(robot_id, 0).load.soil_m3


def heaps(operator: Operator) -> list[tuple[str | None, float]]:
    """Return what lies on the ground."""
    return [(d.pile, round(d.soil_m3, 6)) for d in operator.world.truth().soil]


def test_curling_in_a_pile_fills_the_bucket(operator: Operator) -> None:
    """The bucket has its capacity, and the pile has that much less."""
    operator.dig("digger")
    assert load(operator, "digger") == 0.5
    assert heaps(operator) == [("soil1", 11.5)]


def test_curling_above_the_soil_fills_nothing(operator: Operator) -> None:
    """The tip has to be below the surface."""
    operator.reach("digger", **READY, bucket=OPEN)
    operator.reach("digger", bucket=CLOSED)
    assert load(operator, "digger") == 0


def test_a_closed_bucket_that_goes_through_soil_fills_nothing(operator: Operator) -> None:
    """It has to curl from open to holding."""
    operator.reach("digger", **READY, bucket=CLOSED)
    operator.reach("digger", **DEEP)
    operator.reach("digger", **READY)
    assert load(operator, "digger") == 0


def test_a_bucket_that_opens_again_before_it_holds_has_dug_nothing(operator: Operator) -> None:
    """Half a curl and back leaves the pile as it was."""
    operator.reach("digger", **READY, bucket=OPEN)
    operator.reach("digger", **DEEP)
    operator.reach("digger", bucket=-0.8)
    operator.reach("digger", bucket=OPEN)
    operator.reach("digger", **READY)
    operator.reach("digger", bucket=CLOSED)
    assert load(operator, "digger") == 0
    assert heaps(operator) == [("soil1", 12)]


def test_dig_swing_dump_fills_the_truck(operator: Operator) -> None:
    """A bucket that opens over the bed puts its load there, again and again, until the bed is full."""
    amounts: list[float] = []
    for _ in range(4):
        operator.dig("digger")
        operator.unload("digger", BESIDE)
        amounts.append(load(operator, "truck"))
    assert amounts == [0.5, 1.0, 1.5, 1.5]
    assert load(operator, "digger") == 0
    # what the full bed had no room for lies beside it
    assert heaps(operator) == [("soil1", 10.0), (None, 0.5)]


def test_without_a_truck_the_load_falls_to_the_ground(operator: Operator) -> None:
    """It lies where the bucket opened."""
    operator.dig("digger")
    operator.unload("digger", -BESIDE)
    fallen = operator.world.truth().soil[-1]
    assert fallen.soil_m3 == pytest.approx(0.5)
    assert (fallen.position.x, fallen.position.y) == (pytest.approx(0, abs=0.1), pytest.approx(-AHEAD_M, abs=0.1))


def test_a_truck_that_left_early_stays_empty(operator: Operator) -> None:
    """Only where the bed is now counts."""
    operator.dig("digger")
    operator.drive("truck", 2.0)
    operator.wait(3)
    operator.let_go()
    operator.unload("digger", BESIDE)
    assert load(operator, "truck") == 0
    assert heaps(operator) == [("soil1", 11.5), (None, 0.5)]


def test_a_tipped_bed_drops_its_load_behind(operator: Operator) -> None:
    """All of it, 2.4 m behind the truck's middle, once the bed is steep enough."""
    operator.dig("digger")
    operator.unload("digger", BESIDE)
    operator.reach("truck", bed=0.55)
    assert load(operator, "truck") == 0.5
    operator.reach("truck", bed=1.0)
    assert load(operator, "truck") == 0
    fallen = operator.world.truth().soil[-1]
    assert (fallen.position.x, fallen.position.y) == (pytest.approx(0.3 - 2.4), pytest.approx(AHEAD_M))


def test_what_falls_into_a_tipped_bed_slides_out(operator: Operator) -> None:
    """It lands behind the truck at once."""
    operator.reach("truck", bed=1.0)
    operator.dig("digger")
    operator.unload("digger", BESIDE)
    assert load(operator, "truck") == 0
    assert operator.world.truth().soil[-1].position.x == pytest.approx(0.3 - 2.4)


def test_loads_that_land_together_are_one_heap(operator: Operator) -> None:
    """The second bucket falls on the first."""
    for _ in range(2):
        operator.dig("digger")
        operator.unload("digger", -BESIDE)
    assert heaps(operator) == [("soil1", 11.0), (None, 1.0)]


def test_all_soil_is_conserved_through_any_work(operator: Operator) -> None:
    """Pile, ground, bucket, bed and heaps always add up."""
    before = operator.world.soil_total_m3()
    for swing in (0.0, 2.0, 0.0, -1.0, -BESIDE):
        operator.dig("digger", swing)
        assert operator.world.soil_total_m3() == pytest.approx(before)
        operator.unload("digger", BESIDE)
        assert operator.world.soil_total_m3() == pytest.approx(before)
    operator.reach("truck", bed=1.0)
    assert operator.world.soil_total_m3() == pytest.approx(before)
    assert operator.world.ground.dug_m3 > 0


@pytest.mark.parametrize("thing", [ROCK, OBSTACLE], ids=["rock", "obstacle"])
def test_a_solid_thing_in_reach_is_picked_up_and_put_down(thing: Mapping[str, Any]) -> None:
    """It leaves the ground with the bucket and lies where the bucket opens."""
    name = str(thing["name"])
    with World(pit(thing)) as world:
        operator = Operator(world)
        operator.dig("digger")
        assert world.telemetry("digger", 0).load.bodies == (name,)
        assert name not in world.truth().things
        operator.unload("digger", -BESIDE)
        assert world.telemetry("digger", 0).load.empty
        assert world.truth().things[name].pose.y == pytest.approx(-AHEAD_M, abs=0.1)


def test_a_rock_travels_in_the_bed() -> None:
    """Over a truck it falls into the bed; tipped, it lies behind the truck."""
    with World(pit(ROCK)) as world:
        operator = Operator(world)
        operator.dig("digger")
        operator.unload("digger", BESIDE)
        assert world.telemetry("truck", 0).load.bodies == ("rock1",)
        operator.reach("truck", bed=1.0)
        assert world.truth().things["rock1"].pose.x == pytest.approx(0.3 - 2.4)


def test_digging_at_a_puddle_digs_the_ground_and_leaves_the_puddle() -> None:
    """Water is no load, and soil that falls into it does not fill it up."""
    with World(pit(PUDDLE)) as world:
        operator = Operator(world)
        operator.dig("digger")
        assert world.telemetry("digger", 0).load.soil_m3 == 0.5
        assert world.ground.dug_m3 == 0.5
        operator.unload("digger")
        assert "puddle1" in world.truth().things
        assert heaps(operator) == [(None, 0.5)]


def test_an_exhausted_pile_is_gone() -> None:
    """The last of it goes into the bucket; what is left for the next is the ground."""
    with World(pit({**SOIL, "soil_m3": 0.7})) as world:
        operator = Operator(world)
        for amount in (0.5, 0.2):
            operator.dig("digger")
            assert world.telemetry("digger", 0).load.soil_m3 == pytest.approx(amount)
            operator.unload("digger", BESIDE)
        assert world.truth().soil == ()
        assert world.ground.dug_m3 == 0
