"""Dimensions and joints of the machines."""

import math

import pytest
from muster_schemas.machines import DUMP_TRUCK, EXCAVATOR


def test_a_straight_arm_points_forward() -> None:
    """With all joints at zero the links lie in one line from the boom's foot."""
    forward, up = EXCAVATOR.bucket_tip(0, 0, 0)
    assert forward == pytest.approx(0.3 + 3.9 + 2.3 + 1.0)
    assert up == pytest.approx(1.3)


def test_pitches_add_up() -> None:
    """A raised boom with the arm bent back by as much has a level arm."""
    forward, up = EXCAVATOR.bucket_joint(0.5, -0.5)
    assert forward == pytest.approx(0.3 + 3.9 * math.cos(0.5) + 2.3)
    assert up == pytest.approx(1.3 + 3.9 * math.sin(0.5))


def test_the_bucket_reaches_the_ground_and_a_trucks_bed() -> None:
    """Within its joints' limits the tip gets below the ground and above a bed's wall, in reach of a truck beside it."""
    joints = EXCAVATOR.joints
    steps = 30

    def values(name: str) -> list[float]:
        joint = joints[name]
        return [joint.low + (joint.high - joint.low) * i / steps for i in range(steps + 1)]

    tips = [EXCAVATOR.bucket_tip(b, a, k) for b in values("boom") for a in values("arm") for k in values("bucket")]
    rim = DUMP_TRUCK.bed_floor_z_m + DUMP_TRUCK.bed_wall_m
    assert any(up < -0.2 and 4 < forward < 6 for forward, up in tips)
    assert any(up > rim + 0.2 and 4 < forward < 6 for forward, up in tips)


def test_limits_are_the_right_way_round() -> None:
    """Each joint has a range and a speed, and the bucket holds below where it releases."""
    for joint in (*EXCAVATOR.joints.values(), *DUMP_TRUCK.joints.values()):
        assert joint.low < joint.high
        assert joint.speed_radps > 0
    assert EXCAVATOR.holds_below_rad < EXCAVATOR.releases_above_rad < EXCAVATOR.joints["bucket"].high
    assert DUMP_TRUCK.joints["bed"].low < DUMP_TRUCK.empties_above_rad < DUMP_TRUCK.joints["bed"].high
