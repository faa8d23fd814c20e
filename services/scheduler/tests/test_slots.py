"""Places around objects."""

import itertools
import math

from hypothesis import given, settings
from hypothesis import strategies as st
from muster_scheduler.slots import BESIDE_M, CLEARANCE_M, Disc, Machine, place, stands_right
from muster_schemas.base import Point, Pose
from muster_schemas.site import Bounds

BOUNDS = Bounds(min_x=-32, min_y=-24, max_x=32, max_y=24)
PILE = Disc(Point(x=0, y=0), 2.4)
RADIUS = 2.2


def machine(x: float, y: float, *, truck: bool = False, keep_out: tuple[Disc, ...] = ()) -> Machine:
    """Return an excavator or truck at a place."""
    return Machine(
        robot_id="r",
        pose=Pose(x=x, y=y),
        length_m=3.6,
        radius_m=RADIUS,
        rear_first=truck,
        reach_m=0.0 if truck else 7.5,
        keep_out=keep_out,
    )


def test_an_excavator_faces_the_object_from_its_own_side() -> None:
    """The nearest place on the ring, turned towards the middle."""
    pose = place(PILE, machine(-20, 0), BOUNDS, [])
    assert pose is not None
    assert math.isclose(pose.y, 0, abs_tol=0.1)
    assert -5.2 < pose.x < -4.5
    assert math.isclose(pose.yaw, 0, abs_tol=0.1)


def test_a_truck_stands_with_its_rear_to_the_object_beside_the_excavator() -> None:
    """Beside means within the excavator's reach, without touching it."""
    excavator = place(PILE, machine(-20, 0), BOUNDS, [])
    assert excavator is not None
    truck = place(PILE, machine(20, 0, truck=True), BOUNDS, [Disc(excavator, RADIUS)], [excavator])
    assert truck is not None
    assert 2 * RADIUS <= truck.distance(excavator) <= 6.0
    outwards = math.atan2(truck.y, truck.x)
    assert math.isclose(math.remainder(truck.yaw - outwards, 2 * math.pi), 0, abs_tol=0.01)


def test_there_is_no_place_in_a_corner_that_is_taken() -> None:
    """None, rather than a place that touches something."""
    assert place(PILE, machine(-20, 0), BOUNDS, [Disc(Point(x=0, y=0), 30)]) is None


def test_kept_out_areas_are_no_place_to_stand() -> None:
    """The robot's own rules count, not only what others occupy."""
    keep_out = Disc(Point(x=-5, y=0), 3)
    pose = place(PILE, machine(-20, 0, keep_out=(keep_out,)), BOUNDS, [])
    assert pose is not None
    assert pose.distance(keep_out.centre) >= keep_out.radius_m + RADIUS


def test_a_machine_in_reach_need_not_move() -> None:
    """An excavator by its reach, a truck if its rear is to the object."""
    assert stands_right(PILE, machine(-8, 0))
    assert not stands_right(PILE, machine(-12, 0))
    rear_to_it = Machine(robot_id="t", pose=Pose(x=5, y=0, yaw=0), length_m=3.6, radius_m=RADIUS, rear_first=True)
    front_to_it = Machine(
        robot_id="t", pose=Pose(x=5, y=0, yaw=math.pi), length_m=3.6, radius_m=RADIUS, rear_first=True
    )
    assert stands_right(PILE, rear_to_it)
    assert not stands_right(PILE, front_to_it)


coordinate = st.floats(-25, 25)


@settings(max_examples=50, deadline=None)
@given(
    target=st.tuples(st.floats(-20, 20), st.floats(-12, 12), st.floats(0.3, 3)),
    robots=st.lists(st.tuples(coordinate, st.floats(-20, 20), st.booleans()), min_size=1, max_size=6),
    rock=st.tuples(coordinate, st.floats(-20, 20)),
)
def test_a_whole_crew_gets_distinct_places(
    target: tuple[float, float, float],
    robots: list[tuple[float, float, bool]],
    rock: tuple[float, float],
) -> None:
    """Wherever the object is, nobody touches anybody, anything, or the border."""
    disc = Disc(Point(x=target[0], y=target[1]), target[2])
    taken = [Disc(Point(x=rock[0], y=rock[1]), 0.8)]
    for x, y, truck in robots:
        pose = place(disc, machine(x, y, truck=truck), BOUNDS, taken, [])
        if pose is None:
            continue
        assert abs(pose.x) <= 32 - RADIUS
        assert abs(pose.y) <= 24 - RADIUS
        taken.append(Disc(pose, RADIUS))
    for one, other in itertools.combinations(taken, 2):
        assert one.centre.distance(other.centre) >= one.radius_m + other.radius_m + CLEARANCE_M - 1e-9


def test_five_more_find_room_at_a_small_object() -> None:
    """The ring grows when the first is full."""
    rock = Disc(Point(x=0, y=0), 0.8)
    taken: list[Disc] = []
    for i in range(6):
        pose = place(rock, machine(-20, 3 * i, truck=i > 2), BOUNDS, taken)
        assert pose is not None
        taken.append(Disc(pose, RADIUS))
    assert BESIDE_M < 6
