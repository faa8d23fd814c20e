"""Tipping (FD2): empty the bed where the load is wanted."""

import math

from muster_schemas.machines import DUMP_TRUCK
from muster_schemas.robot import SkillRequest, TargetObject

from muster_robot_agent.kinematics import bearing, place, wrap
from muster_robot_agent.machine import Machine, SkillFailedError, Steps
from muster_robot_agent.navigation import traffic
from muster_robot_agent.navigation.controller import turn_towards
from muster_robot_agent.navigation.navigator import neighbours_of

from .motion import approach, lower_bed, move_joints

TIPPED_RAD = 1.0
EMPTY_WAIT_S = 10.0
BACK_UP_CLASSES = frozenset({"puddle", "soil"})
"""What the load is brought right to; from anything else the truck keeps its distance."""
PULL_FORWARD_M = 2.5
STRAIGHT_WAIT_S = 60.0


def tip(machine: Machine, request: SkillRequest) -> Steps:
    """Back up to the request's object, tip, see the bed empty, lower it and pull forward."""
    target = yield from approach(machine, request, machine.card.radius_m + 6.0)
    if machine.load.empty:
        yield from lower_bed(machine)
        machine.note = "the bed was empty already"
        return
    if target is not None:
        yield from _rear_towards(machine, target)
        if target.object_class in BACK_UP_CLASSES:
            yield from _straight(machine, -_way_back(machine, target), target, f"back up to {target.name}")
    machine.progress = 0.7
    yield from move_joints(machine, {"bed": TIPPED_RAD})
    deadline = machine.now + EMPTY_WAIT_S
    while not machine.load.empty:
        if machine.now > deadline:
            raise SkillFailedError("the bed is tipped, but telemetry says that it is not empty")
        yield
    yield from lower_bed(machine)
    if target is not None and target.object_class in BACK_UP_CLASSES:
        yield from _straight(machine, PULL_FORWARD_M, target, None)


def _rear_towards(machine: Machine, target: TargetObject) -> Steps:
    while True:
        error = wrap(bearing(machine.pose, target.position) - math.pi)
        if abs(error) < 0.06 and machine.still:
            return
        if abs(error) >= 0.05:
            machine.drive(0.0, turn_towards(error, machine.type.max_turn_radps))
        yield


def _way_back(machine: Machine, target: TargetObject) -> float:
    """Return how far to reverse so that the load lands on a puddle's middle, or on the near edge of a pile."""
    drop_m = -DUMP_TRUCK.drop_x_m
    stop_m = drop_m if target.object_class == "puddle" else drop_m + 0.9 * target.radius_m
    return max(machine.pose.distance(target.position) - stop_m, 0.0)


def _straight(machine: Machine, way_m: float, target: TargetObject, purpose: str | None) -> Steps:
    """Drive straight forward (or back, if negative), not into anyone; without a purpose a blocked way just ends it."""
    start, deadline = machine.pose, machine.now + STRAIGHT_WAIT_S
    try:
        while True:
            left = abs(way_m) - start.distance(machine.pose)
            if left <= 0.05:
                if machine.still:
                    return
                yield
                continue
            speed = math.copysign(min(0.8 * left + 0.05, 0.8), way_m)
            speed, body = traffic.safe_speed(machine.pose, speed, left, neighbours_of(machine))
            if body is None and _clear(machine, speed, target):
                machine.path = (machine.pose, place(machine.pose, math.copysign(left, way_m)))
                machine.drive(speed, wrap(start.yaw - machine.pose.yaw))
            elif purpose is None:
                return
            elif machine.now > deadline:
                reason = body.robot_id if body else "something that it must not touch"
                raise SkillFailedError(f"could not {purpose}: {reason} is in the way")
            yield
    finally:
        machine.path = ()


def _clear(machine: Machine, speed: float, target: TargetObject) -> bool:
    """Return whether going on leads neither out of bounds, nor into a closed area, nor against a solid thing."""
    around = machine.surroundings
    then = place(machine.pose, math.copysign(0.5, speed))
    bounds, edge = around.site.bounds, machine.card.length_m / 2
    if not (bounds.min_x + edge < then.x < bounds.max_x - edge and bounds.min_y + edge < then.y < bounds.max_y - edge):
        return False
    circles = [(o.position, o.radius_m + edge + 0.1) for o in around.solid_objects() if o.name != target.name]
    circles += [(r.centre, r.radius_m + edge) for r in around.my_rules()]
    return not any(
        centre.distance(then) < radius and centre.distance(then) < centre.distance(machine.pose)
        for centre, radius in circles
    )
