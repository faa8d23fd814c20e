"""Driving: to places beside objects (N2), and home (N4)."""

from muster_schemas.robot import SkillRequest

from muster_robot_agent.machine import Machine, SkillFailedError, Steps

from .motion import drive_to, forbid_avoided


def target_area(machine: Machine, request: SkillRequest) -> Steps:
    """Visit the slots of the request's objects in turn."""
    if not request.goals:
        raise SkillFailedError("no place to drive to is given")
    for target in request.objects:
        forbid_avoided(machine, target)
    count = len(request.goals)
    for number, goal in enumerate(request.goals):
        name = request.objects[number].name if number < len(request.objects) else "the given place"
        yield from drive_to(machine, goal, name, (number / count, (number + 1) / count))


def return_to_start(machine: Machine, request: SkillRequest) -> Steps:  # noqa: ARG001  (skills share one form)
    """Drive to where the robot started."""
    yield from drive_to(machine, machine.card.home, "its home")
