"""Forward and inverse kinematics agree."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from muster_robot_agent.kinematics import bearing, bed_centre, place, reach_with_tip
from muster_schemas.base import Point, Pose
from muster_schemas.machines import EXCAVATOR


@given(st.floats(2.0, 8.0), st.floats(-1.0, 4.0), st.floats(-2.2, 0.6))
def test_joints_found_for_a_place_bring_the_tip_there(forward: float, up: float, bucket: float) -> None:
    """Whenever there is an answer it is exact and within the joints' limits."""
    joints = reach_with_tip(forward, up, bucket)
    if joints is None:
        return
    assert EXCAVATOR.bucket_tip(**joints) == pytest.approx((forward, up), abs=1e-6)
    for name, angle in joints.items():
        assert EXCAVATOR.joints[name].low <= angle <= EXCAVATOR.joints[name].high


@pytest.mark.parametrize("forward", [4.0, 5.0, 6.0, 7.0])
def test_the_ground_around_is_within_reach(forward: float) -> None:
    """From the tracks' edge out to seven metres an open bucket reaches the ground."""
    assert reach_with_tip(forward, 0.0, -0.25) is not None


def test_what_is_too_far_has_no_answer() -> None:
    """Nothing is made up for a place beyond boom, arm and bucket."""
    assert reach_with_tip(9.0, 0.0, -0.25) is None


def test_places_and_bearings_are_inverse() -> None:
    """A place ahead and to the left is seen ahead and to the left."""
    pose = Pose(x=1, y=2, yaw=2.5)
    assert bearing(pose, place(pose, 3.0, 3.0)) == pytest.approx(math.pi / 4)


def test_the_bed_is_behind_the_middle_of_the_truck() -> None:
    """A truck that faces north has its bed to the south."""
    centre = bed_centre(Pose(x=0, y=0, yaw=math.pi / 2))
    assert centre.distance(Point(x=0, y=-0.3)) < 1e-9
