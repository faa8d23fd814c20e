"""Where joints bring a bucket, and which joints bring it somewhere; geometry of poses. Metres, radians."""

import math

from muster_schemas.base import Point, Pose
from muster_schemas.machines import DUMP_TRUCK, EXCAVATOR

Joints = dict[str, float]


def wrap(angle: float) -> float:
    """Return the same direction in (-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))


def place(pose: Pose, forward_m: float, left_m: float = 0.0) -> Point:
    """Return the point of the ground at these coordinates in a robot's frame."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return Point(x=pose.x + forward_m * cos - left_m * sin, y=pose.y + forward_m * sin + left_m * cos)


def bearing(pose: Pose, point: Point) -> float:
    """Return the direction of a point as seen by a robot (0 = straight ahead)."""
    return wrap(math.atan2(point.y - pose.y, point.x - pose.x) - pose.yaw)


def bed_centre(truck: Pose) -> Point:
    """Return the middle of a dump truck's level bed."""
    return place(truck, DUMP_TRUCK.bed_centre_x_m)


def clamp(name: str, angle: float) -> float:
    """Return the angle within the limits of an excavator's joint."""
    limit = EXCAVATOR.joints[name]
    return min(max(angle, limit.low), limit.high)


def reach_with_tip(forward_m: float, up_m: float, bucket: float) -> Joints | None:
    """Return boom, arm and bucket joints that put the bucket's tip there, or None where it cannot be.

    Arm and bucket with the bucket at a fixed angle are one straight link from the arm's pivot to the tip, so this is
    the inverse of two links with the elbow up.

    Args:
        forward_m: from the swing axis, in the plane of the upper body.
        up_m: above the ground that the tracks stand on.
        bucket: the joint angle that the bucket keeps.

    """
    machine = EXCAVATOR
    x, z = forward_m - machine.boom_foot_x_m, up_m - machine.boom_foot_z_m
    first = machine.boom_m
    second = math.sqrt(machine.arm_m**2 + machine.bucket_m**2 + 2 * machine.arm_m * machine.bucket_m * math.cos(bucket))
    # how far the line to the tip turns away from the arm itself
    away = math.atan2(machine.bucket_m * math.sin(bucket), machine.arm_m + machine.bucket_m * math.cos(bucket))
    distance_squared = x * x + z * z
    cosine = (distance_squared - first**2 - second**2) / (2 * first * second)
    if not -1 <= cosine <= 1:
        return None
    elbow = -math.acos(cosine)
    boom = math.atan2(z, x) - math.atan2(second * math.sin(elbow), first + second * math.cos(elbow))
    joints = {"boom": wrap(boom), "arm": wrap(elbow - away), "bucket": bucket}
    return joints if all(_allowed(name, angle) for name, angle in joints.items()) else None


def _allowed(name: str, angle: float) -> bool:
    limit = EXCAVATOR.joints[name]
    return limit.low <= angle <= limit.high


def tip_place(pose: Pose, joints: Joints) -> tuple[Point, float]:
    """Return where on the ground an excavator's bucket tip is, and its height."""
    forward, up = EXCAVATOR.bucket_tip(joints["boom"], joints["arm"], joints["bucket"])
    return place(Pose(x=pose.x, y=pose.y, yaw=pose.yaw + joints["swing"]), forward), up
