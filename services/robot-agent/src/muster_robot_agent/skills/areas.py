"""Area rules: obey a revision of them (N1, N3)."""

import math

from muster_schemas.base import Pose
from muster_schemas.robot import SkillRequest

from muster_robot_agent.machine import Machine, SkillFailedError, Steps

from .motion import drive_to

RULES_WAIT_S = 20.0


def obey_rules(machine: Machine, request: SkillRequest) -> Steps:
    """Wait until the rules of the asked revision hold here; drive out of an area that has just been closed."""
    wanted = request.rules_revision or 0
    deadline = machine.now + RULES_WAIT_S
    while machine.surroundings.rules.revision < wanted:
        if machine.now > deadline:
            raise SkillFailedError(
                f"area rules of revision {wanted} did not arrive; this robot has {machine.surroundings.rules.revision}"
            )
        yield
    machine.progress = 0.5
    rule = machine.surroundings.rule_at(machine.pose)
    if rule is not None:
        pose = machine.pose
        away = math.atan2(pose.y - rule.centre.y, pose.x - rule.centre.x)
        outside = rule.radius_m + machine.card.radius_m + 0.5
        bounds, edge = machine.surroundings.site.bounds, machine.card.radius_m
        for turned in (0.0, 0.5, -0.5, 1.0, -1.0, 1.6, -1.6, 2.3, -2.3, math.pi):
            angle = away + turned
            x, y = rule.centre.x + outside * math.cos(angle), rule.centre.y + outside * math.sin(angle)
            in_bounds = bounds.min_x + edge < x < bounds.max_x - edge and bounds.min_y + edge < y < bounds.max_y - edge
            goal = Pose(x=x, y=y, yaw=angle)
            if in_bounds and machine.surroundings.rule_at(goal) is None:
                yield from drive_to(machine, goal, f"a place outside the area of {rule.object_name}", (0.5, 1.0))
                return
        raise SkillFailedError(f"it stands in the area of {rule.object_name} and sees no place outside it to go to")
