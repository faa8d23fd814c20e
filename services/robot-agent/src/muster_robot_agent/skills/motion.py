"""Moves that several skills are made of: joints to places, travel posture, driving to where a task is done."""

from collections.abc import Generator

from muster_schemas.base import Pose
from muster_schemas.machines import DUMP_TRUCK
from muster_schemas.robot import SkillRequest, TargetObject

from muster_robot_agent.kinematics import Joints
from muster_robot_agent.machine import Machine, SkillFailedError, Steps
from muster_robot_agent.navigation.navigator import Navigator

TRAVEL: Joints = {"swing": 0.0, "boom": 0.9, "arm": -2.2, "bucket": -1.8}
"""Arm drawn in and bucket curled: nothing falls out and little sticks out."""
LEVEL: Joints = {"bed": 0.0}
JOINT_REACHED_RAD = 0.04
JOINT_WAIT_S = 20.0


def move_joints(machine: Machine, joints: Joints) -> Steps:
    """Move joints there and wait until telemetry shows it.

    Raises:
        SkillFailedError: a joint does not get there.

    """
    deadline = machine.now + JOINT_WAIT_S
    while True:
        machine.move(joints)
        gaps = {name: abs(machine.telemetry.joints.get(name, angle) - angle) for name, angle in joints.items()}
        if all(gap < JOINT_REACHED_RAD for gap in gaps.values()):
            return
        if machine.now > deadline:
            worst = max(gaps, key=lambda name: gaps[name])
            raise SkillFailedError(f"the {worst} joint stays {gaps[worst]:.2f} rad away from where it should go")
        yield


def stow(machine: Machine) -> Steps:
    """Bring the tool into the posture for driving: an excavator's arm first up, then round; a truck's bed down."""
    if machine.type.body == "excavator":
        current = machine.telemetry.joints
        if current["boom"] < 0.6:
            yield from move_joints(machine, {"boom": TRAVEL["boom"]})
        yield from move_joints(machine, TRAVEL)
    elif machine.type.body == "dump_truck":
        yield from move_joints(machine, LEVEL)


def lower_bed(machine: Machine) -> Steps:
    """Bring the bed down, and hold everything else."""
    if machine.telemetry.joints.get("bed", 0.0) > DUMP_TRUCK.joints["bed"].low + JOINT_REACHED_RAD:
        yield from move_joints(machine, LEVEL)


def drive_to(machine: Machine, goal: Pose, destination: str, share: tuple[float, float] = (0.0, 1.0)) -> Steps:
    """Drive to a pose around everything.

    Args:
        machine: to drive.
        goal: where to stand.
        destination: its name, for a person.
        share: what progress of the skill this drive is, from and to.

    Raises:
        SkillFailedError: there is no way, or somebody stands in it for too long.

    """
    if machine.pose.distance(goal) > 0.3:
        yield from stow(machine)
    navigator = Navigator(machine, goal, destination)
    try:
        while not navigator.step():
            machine.progress = share[0] + (share[1] - share[0]) * navigator.progress
            yield
    finally:
        machine.path = ()


def forbid_avoided(machine: Machine, target: TargetObject) -> None:
    """Refuse an object that an area rule keeps this robot away from.

    Raises:
        SkillFailedError: there is such a rule; the message names it.

    """
    rule = machine.surroundings.rule_against(target.name)
    if rule is not None:
        raise SkillFailedError(
            f"{machine.card.robot_id} must avoid {target.name} (area rules, revision "
            f"{machine.surroundings.rules.revision}); allow it first"
        )


def approach(machine: Machine, request: SkillRequest, within_m: float) -> Generator[None, None, TargetObject | None]:
    """Drive to the request's slot if its object is farther away than this; return the object, if it has one.

    Args:
        machine: to drive.
        request: with at most one object that counts, and a slot beside it.
        within_m: how far the object's edge may be from the machine's centre.

    Raises:
        SkillFailedError: the object is out of reach and no slot is given, or an area rule forbids it.

    """
    if not request.objects:
        return None
    target = request.objects[0]
    forbid_avoided(machine, target)
    if machine.pose.distance(target.position) - target.radius_m > within_m:
        if not request.goals:
            raise SkillFailedError(f"{target.name} is out of reach and no place to stand beside it is given")
        yield from drive_to(machine, request.goals[0], target.name, (0.0, 0.5))
    return target
