"""What robots hide."""

from collections.abc import Callable

import numpy as np
from muster_schemas.base import Pose
from muster_schemas.robot import RobotState
from muster_schemas.site import Site
from muster_schemas.world import CameraFrame
from muster_vision.birdseye import BirdsEye, Grid
from muster_vision.robots import RobotWatch, Stand, shadows

MakeFrame = Callable[..., CameraFrame]


def state(robot_id: str, x: float, at: float) -> RobotState:
    """Return a robot's message."""
    return RobotState(robot_id=robot_id, boot_id="boot", seq=0, pose=Pose(x=x, y=0.0), at=at)


def test_where_a_robot_was_when_a_picture_was_taken_counts_and_where_it_is_now(yard: Site) -> None:
    """Pictures arrive later than poses; what lies between is of no interest."""
    watch = RobotWatch(yard)
    for second in range(10):
        watch.take(state("robot_dump_truck_01", float(second), 100.0 + second))
    assert sorted(s.x for s in watch.stands([103.1])) == [3.0, 9.0]


def test_a_robot_that_stands_still_counts_once(yard: Site) -> None:
    """However often it says so."""
    watch = RobotWatch(yard)
    for _ in range(20):
        watch.take(state("robot_excavator_01", 1.0, 100.0))
    assert len(watch.stands([100.0])) == 1


def test_a_robot_that_the_site_does_not_name_hides_something_too(yard: Site) -> None:
    """Someone else's machine may drive here."""
    watch = RobotWatch(yard)
    watch.take(state("visitor", 1.0, 100.0))
    assert watch.stands([])[0].kind.length_m > 3


def test_a_robot_hides_the_ground_behind_it_as_the_camera_sees_it(
    yard: Site, grid: Grid, make_frame: MakeFrame, one_colour: Callable[..., bytes]
) -> None:
    """West of a camera its top leans west; before it the ground is free."""
    view = BirdsEye(grid)
    view.add(make_frame(6.0, 0.0, 10.0, angle_deg=110.0), one_colour((90, 90, 90)))
    hidden = shadows(view, [Stand(-1.0, 0.0, 0.0, yard.robot_types["dump_truck"])])
    behind, under, before = (
        hidden.mask[grid.rows // 2, round(grid.to_cells(np.array([[x, 0.0]]))[0, 0])] for x in (-4.2, -1.0, 1.6)
    )
    assert behind
    assert under
    assert not before
    assert hidden.near.sum() > hidden.mask.sum()


def test_without_robots_nothing_is_hidden(grid: Grid, make_frame: MakeFrame, one_colour: Callable[..., bytes]) -> None:
    """And nothing is near one."""
    view = BirdsEye(grid)
    view.add(make_frame(), one_colour((90, 90, 90)))
    assert not shadows(view, []).near.any()
