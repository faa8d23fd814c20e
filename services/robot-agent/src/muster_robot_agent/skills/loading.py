"""Being loaded (FD1): stand still until the bed has grown fuller than it was on arrival."""

from muster_schemas.robot import SkillRequest

from muster_robot_agent.kinematics import bed_centre
from muster_robot_agent.machine import Machine, Steps

from .motion import approach, drive_to, lower_bed

BESIDE_M = 8.0
"""So near to the object's edge an excavator that works there may reach the bed."""
BED_MARGIN_M = 0.9
"""Over the bed's walls an arm reaches less far than on the ground."""


def take_on_load(machine: Machine, request: SkillRequest) -> Steps:
    """Stand with a level bed; done when an excavator's load has come, or at once if none is to come."""
    yield from approach(machine, request, BESIDE_M)
    if request.goals and _out_of_reach(machine, request.partner) and machine.pose.distance(request.goals[0]) > 0.5:
        yield from drive_to(machine, request.goals[0], f"a place beside {request.partner}", (0.0, 0.5))
    yield from lower_bed(machine)
    while not machine.still:
        yield
    machine.progress = 0.5
    if request.partner is None:
        machine.note = "ready to be loaded"
        return
    # it may have come before this task began; the load that counts is the one on arrival
    while not machine.loaded_here:
        yield
    machine.note = f"loaded: {machine.load.soil_m3:.2f} m3 in the bed" if not machine.load.bodies else "loaded"


def _out_of_reach(machine: Machine, partner: str | None) -> bool:
    """Return whether the excavator stands where its bucket does not come over the bed."""
    excavator = machine.surroundings.others.get(partner) if partner else None
    if excavator is None or excavator.path:
        return False
    reach_m = machine.surroundings.reach_of(excavator.robot_id) - BED_MARGIN_M
    return bed_centre(machine.pose).distance(excavator.pose) > reach_m
