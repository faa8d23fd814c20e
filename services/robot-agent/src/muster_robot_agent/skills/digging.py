"""Digging (FE1): fill the bucket from a pile, the ground, or by picking something up."""

import math
from dataclasses import dataclass

from muster_schemas.base import Point
from muster_schemas.robot import SkillRequest, TargetObject

from muster_robot_agent.kinematics import Joints, bearing, place, reach_with_tip
from muster_robot_agent.machine import Machine, SkillFailedError, Steps

from .motion import TRAVEL, approach, move_joints
from .unloading import put_down

PICKED_UP = frozenset({"obstacle", "rock"})
OPEN_RAD = -0.25
"""Bucket joint while reaching down: open, since it releases above -0.5."""
CURLED_RAD = -1.6
CURL_STEPS = 4
FULL = 0.6
"""Share of the bucket's capacity from which on a bucket counts as full."""
IN_FRONT_M = 5.0
REACH_MARGIN_M = 0.3


@dataclass(frozen=True)
class Bite:
    """Where the tip goes in: distance from the swing axis, height, direction."""

    forward_m: float
    up_m: float
    swing: float


def dig(machine: Machine, request: SkillRequest) -> Steps:
    """Fill the bucket at the request's object, or at what is in reach; succeeds when telemetry shows the load."""
    target = yield from approach(machine, request, machine.card.reach_m - 1.0)
    if target is None:
        target = _in_reach(machine)
    picks_up = target is not None and target.object_class in PICKED_UP
    if machine.load.bodies or (picks_up and not machine.load.empty):
        machine.note = "put down what was in the bucket first"
        yield from put_down(machine)
    if machine.load.soil_m3 >= FULL * machine.card.capacity_m3:
        machine.note = "the bucket was full already"
        return
    at = place(machine.pose, IN_FRONT_M) if target is None else target.position
    name = "the ground in front" if target is None else target.name
    bites = _bites(machine, at, target)
    if not bites:
        raise SkillFailedError(f"the bucket does not reach {name} from here")
    for number, bite in enumerate(bites):
        machine.progress = 0.5 + 0.45 * number / len(bites)
        yield from _bite(machine, bite)
        # soil in the bucket is not the thing that was to be picked up
        if machine.load.bodies or (not picks_up and not machine.load.empty):
            break
    else:
        what = "pick up" if picks_up else "dig"
        raise SkillFailedError(f"there is nothing to {what} at {name}: {len(bites)} tries brought nothing")
    yield from move_joints(machine, {"boom": TRAVEL["boom"]})


def _in_reach(machine: Machine) -> TargetObject | None:
    """Return the nearest soil pile, else obstacle or rock, that the bucket reaches from here."""
    reach = machine.card.reach_m - 1.0
    near = [
        TargetObject(name=o.name, object_class=o.object_class, position=o.position, radius_m=o.radius_m)
        for o in machine.surroundings.solid_objects()
        if o.object_class in PICKED_UP | {"soil"} and machine.pose.distance(o.position) - o.radius_m <= reach
    ]
    near.sort(key=lambda o: (o.object_class != "soil", machine.pose.distance(o.position)))
    return near[0] if near else None


def _bites(machine: Machine, at: Point, target: TargetObject | None) -> list[Bite]:
    """Return the places to try in turn, only those that the bucket reaches."""
    distance, swing = machine.pose.distance(at), bearing(machine.pose, at)
    if target is not None and target.object_class in PICKED_UP:
        tries = [(0.0, 0.3, 0.0), (0.0, 0.1, 0.0), (-0.5, 0.2, 0.0), (0.3, 0.1, 0.08), (-0.3, 0.1, -0.08)]
    elif target is not None and target.object_class == "soil":
        # first into the side that is near, then deeper and farther into what is left
        edge = -0.45 * target.radius_m
        tries = [(edge, 0.1, 0.0), (edge / 2, 0.0, 0.0), (0.0, 0.0, 0.0), (edge, -0.1, 0.12), (edge, -0.1, -0.12)]
    else:
        tries = [(0.0, -0.25, 0.0), (-0.4, -0.35, 0.1), (0.3, -0.35, -0.1)]
    bites = [Bite(distance + along, up, swing + turned) for along, up, turned in tries]
    farthest = machine.card.reach_m - REACH_MARGIN_M
    bites = [Bite(min(b.forward_m, farthest), b.up_m, math.remainder(b.swing, math.tau)) for b in bites]
    return [b for b in bites if _curl(b)]


def _curl(bite: Bite) -> list[Joints]:
    """Return the postures of a curl that keeps the tip in place while the bucket turns from open to holding.

    Empty if the bucket does not reach there.
    """
    postures: list[Joints] = []
    for number in range(CURL_STEPS + 1):
        bucket = OPEN_RAD + (CURLED_RAD - OPEN_RAD) * number / CURL_STEPS
        # late in the curl the tip may rise a little where the arm cannot follow
        lifts = (reach_with_tip(bite.forward_m, bite.up_m + lift, bucket) for lift in (0.0, 0.15, 0.3))
        joints = next((j for j in lifts if j), None)
        if joints is None:
            if bucket > -1.05:
                return []
            joints = {**postures[-1], "bucket": bucket}
        postures.append(joints)
    return postures


def _bite(machine: Machine, bite: Bite) -> Steps:
    """Swing there above the ground, reach down, curl, lift."""
    postures = _curl(bite)
    down = postures[0]
    above = reach_with_tip(bite.forward_m, bite.up_m + 1.9, OPEN_RAD) or {**down, "boom": min(down["boom"] + 0.5, 1.2)}
    yield from move_joints(machine, {"boom": TRAVEL["boom"]})
    yield from move_joints(machine, {"swing": bite.swing})
    yield from move_joints(machine, above)
    yield from move_joints(machine, down)
    for posture in postures[1:]:
        yield from move_joints(machine, posture)
    yield from move_joints(machine, {"boom": TRAVEL["boom"], "bucket": CURLED_RAD})
