"""Unloading the bucket (FE2): into a dump truck beside, or onto the ground at the side."""

import math

from muster_schemas.base import Point
from muster_schemas.machines import DUMP_TRUCK
from muster_schemas.robot import RobotState, SkillRequest

from muster_robot_agent.kinematics import Joints, bearing, bed_centre, clamp, place, reach_with_tip
from muster_robot_agent.machine import Machine, SkillFailedError, Steps

from .motion import TRAVEL, approach, drive_to, move_joints

RELEASE_RAD = -0.2
HOLD_RAD = -1.6
PARTNER_WAIT_S = 180.0
"""Site time to wait for the truck to stand in reach with room."""
SEEN_WAIT_S = 6.0
"""Site time to wait for the truck to tell that its load has grown."""
OVER_BED_M = DUMP_TRUCK.bed_floor_z_m + DUMP_TRUCK.bed_wall_m + 0.35
SIDES_RAD = (math.pi / 2, -math.pi / 2, 1.1, -1.1, 2.1, -2.1, 0.6, -0.6, 2.7, -2.7, 0.0)
PUT_DOWN_M = 4.6
PUT_DOWN_HEIGHT_M = 0.8


def unload(machine: Machine, request: SkillRequest) -> Steps:
    """Empty the bucket into the partner, else into a truck in reach, else onto the ground."""
    yield from approach(machine, request, machine.card.reach_m + 4.0)
    if machine.load.empty:
        machine.note = "the bucket was empty already"
        return
    if request.partner is not None:
        state = machine.surroundings.others.get(request.partner)
        beside = state is None or not _stands(state) or _over_bed(machine, state) is not None
        if request.goals and not beside and machine.pose.distance(request.goals[0]) > 0.5:
            yield from drive_to(machine, request.goals[0], f"a place beside {request.partner}", (0.0, 0.3))
        yield from _wait_for(machine, request.partner)
        yield from _into(machine, request.partner)
        return
    truck = _nearest_truck(machine)
    if truck is not None:
        yield from _into(machine, truck)
    else:
        yield from put_down(machine)
        machine.note = "emptied onto the ground: no truck with room was in reach"


def put_down(machine: Machine) -> Steps:
    """Empty the bucket onto free ground at the side."""
    yield from move_joints(machine, {"boom": TRAVEL["boom"]})
    swing = _free_side(machine)
    posture = reach_with_tip(PUT_DOWN_M, PUT_DOWN_HEIGHT_M, RELEASE_RAD)
    if posture is None:
        raise SkillFailedError("the arm cannot reach the ground at the side")
    yield from move_joints(machine, {"swing": swing})
    yield from move_joints(machine, {"boom": posture["boom"], "arm": posture["arm"]})
    yield from _open(machine)
    yield from _arm_up(machine)


def _wait_for(machine: Machine, truck_id: str) -> Steps:
    deadline = machine.now + PARTNER_WAIT_S
    while (obstacle := _hindrance(machine, truck_id)) is not None:
        if machine.now > deadline:
            raise SkillFailedError(f"cannot unload into {truck_id}: {obstacle}")
        yield
    machine.progress = 0.3


def _hindrance(machine: Machine, truck_id: str) -> str | None:
    """Return why nothing can be emptied into a truck now, or None."""
    state = machine.surroundings.others.get(truck_id)
    if state is None:
        return "its agent says nothing"
    if not _stands(state):
        return "it is driving"
    if _over_bed(machine, state) is None:
        distance = machine.pose.distance(bed_centre(state.pose))
        return f"its bed is {distance:.1f} m away, out of reach"
    if machine.surroundings.capacity_of(truck_id) - state.load.soil_m3 < min(machine.load.soil_m3, 0.1):
        return "its bed is full"
    return None


def _stands(state: RobotState) -> bool:
    return abs(state.speed_mps) < 0.05 and not state.path


def _over_bed(machine: Machine, state: RobotState) -> Joints | None:
    """Return the joints that put the opening bucket over the middle of the bed."""
    middle = bed_centre(state.pose)
    posture = reach_with_tip(machine.pose.distance(middle), OVER_BED_M, RELEASE_RAD)
    return posture and {**posture, "swing": bearing(machine.pose, middle)}


def _nearest_truck(machine: Machine) -> str | None:
    around = machine.surroundings
    trucks = [
        (machine.pose.distance(s.pose), s.robot_id)
        for s in around.others.values()
        if around.is_dump_truck(s.robot_id) and _hindrance(machine, s.robot_id) is None
    ]
    return min(trucks)[1] if trucks else None


def _into(machine: Machine, truck_id: str) -> Steps:
    before = machine.surroundings.others[truck_id]
    posture = _over_bed(machine, before)
    if posture is None:
        raise SkillFailedError(f"the bed of {truck_id} is out of reach")
    yield from move_joints(machine, {"boom": 1.0, "bucket": HOLD_RAD})
    yield from move_joints(machine, {"swing": posture["swing"]})
    yield from move_joints(machine, {"arm": posture["arm"]})
    yield from move_joints(machine, {"boom": posture["boom"]})
    machine.progress = 0.6
    now = machine.surroundings.others[truck_id]
    if not _stands(now) or now.pose.distance(before.pose) > 0.3:
        yield from _arm_up(machine)
        raise SkillFailedError(f"{truck_id} drove away before the bucket was over its bed")
    yield from _open(machine)
    machine.progress = 0.8
    deadline = machine.now + SEEN_WAIT_S
    while not _fuller(machine.surroundings.others[truck_id], before):
        if machine.now > deadline:
            yield from _arm_up(machine)
            raise SkillFailedError(f"the bucket is empty, but the load of {truck_id} has not grown: it fell beside")
        yield
    yield from _arm_up(machine)


def _fuller(now: RobotState, before: RobotState) -> bool:
    return now.load.soil_m3 > before.load.soil_m3 + 0.01 or len(now.load.bodies) > len(before.load.bodies)


def _open(machine: Machine) -> Steps:
    yield from move_joints(machine, {"bucket": RELEASE_RAD})
    deadline = machine.now + SEEN_WAIT_S
    while not machine.load.empty:
        if machine.now > deadline:
            raise SkillFailedError("the bucket is open, but telemetry says that it is not empty")
        yield


def _arm_up(machine: Machine) -> Steps:
    """Lift the emptied bucket clear of what is below it."""
    yield from move_joints(machine, {"boom": 1.0})
    yield from move_joints(machine, {"bucket": HOLD_RAD})


def _free_side(machine: Machine) -> float:
    """Return the first direction where the ground is free of robots and solid things."""
    around = machine.surroundings
    taken: list[tuple[Point, float]] = [(s.pose, around.radius_of(s.robot_id) + 1.2) for s in around.others.values()]
    taken += [(o.position, o.radius_m + 0.9) for o in around.solid_objects()]
    room = [
        (min((place_of.distance(p) - r for p, r in taken), default=math.inf), side)
        for side in SIDES_RAD
        if (place_of := place(machine.pose, PUT_DOWN_M * math.cos(side), PUT_DOWN_M * math.sin(side)))
    ]
    free = next((side for distance, side in room if distance >= 0), max(room)[1])
    return clamp("swing", free)
