"""What an agent knows of the site around its robot: objects, area rules, other robots."""

import math
from dataclasses import dataclass, field

from muster_schemas.base import Point
from muster_schemas.robot import RobotCard, RobotState
from muster_schemas.site import RobotType, Site
from muster_schemas.world import AreaRule, AreaRules, MapObject

UNKNOWN_RADIUS_M = 2.5
"""Assumed of a robot that neither the site's file nor a card describes."""


@dataclass
class SiteView:
    """What all agents of a process know together; filled by subscriptions."""

    site: Site
    objects: dict[str, MapObject] = field(default_factory=dict[str, MapObject])
    rules: AreaRules = field(default_factory=lambda: AreaRules(revision=0))
    states: dict[str, RobotState] = field(default_factory=dict[str, RobotState])
    """The last word of every robot; one that has fallen silent still stands where it said."""
    cards: dict[str, RobotCard] = field(default_factory=dict[str, RobotCard])

    def __post_init__(self) -> None:
        self.types: dict[str, RobotType] = {r.id: self.site.robot_types[r.type] for r in self.site.robots}
        """By robot, as the site's file gives them."""


@dataclass(frozen=True)
class Surroundings:
    """The site as one robot sees it."""

    view: SiteView
    robot_id: str

    @property
    def site(self) -> Site:
        """The site's file."""
        return self.view.site

    @property
    def rules(self) -> AreaRules:
        """The area rules that hold."""
        return self.view.rules

    @property
    def others(self) -> dict[str, RobotState]:
        """The last word of every other robot."""
        return {name: state for name, state in self.view.states.items() if name != self.robot_id}

    def radius_of(self, robot_id: str) -> float:
        """Return the radius of the circle that holds a robot's footprint, in metres."""
        if robot_id in self.view.cards:
            return self.view.cards[robot_id].radius_m
        kind = self.type_of(robot_id)
        return math.hypot(kind.length_m, kind.width_m) / 2 if kind else UNKNOWN_RADIUS_M

    def type_of(self, robot_id: str) -> RobotType | None:
        """Return the type that the site's file gives a robot."""
        return self.view.types.get(robot_id)

    def capacity_of(self, robot_id: str) -> float:
        """Return what a robot's bucket or bed holds, in cubic metres."""
        if robot_id in self.view.cards:
            return self.view.cards[robot_id].capacity_m3
        kind = self.type_of(robot_id)
        return kind.capacity_m3 if kind else 0.0

    def reach_of(self, robot_id: str) -> float:
        """Return how far a robot's tool reaches from its centre, in metres."""
        if robot_id in self.view.cards:
            return self.view.cards[robot_id].reach_m
        kind = self.type_of(robot_id)
        return kind.reach_m if kind else 0.0

    def is_dump_truck(self, robot_id: str) -> bool:
        """Return whether soil can be emptied into a robot."""
        kind = self.type_of(robot_id)
        if kind is None and robot_id in self.view.cards:
            kind = self.site.robot_types.get(self.view.cards[robot_id].type)
        return kind is not None and kind.body == "dump_truck"

    def solid_objects(self) -> list[MapObject]:
        """Return the objects that no robot may drive over: all but those of flat classes, also what nobody knows.

        Robots in the picture are left out, since their own states say better where they are.
        """
        robots = {*self.site.robot_types, *(t.body for t in self.site.robot_types.values())}
        return [o for o in self.view.objects.values() if o.object_class not in robots.union(self.site.vision.flat)]

    def my_rules(self) -> tuple[AreaRule, ...]:
        """Return what this robot keeps out of."""
        return self.view.rules.avoided_by(self.robot_id)

    def rule_against(self, name: str) -> AreaRule | None:
        """Return the rule that keeps this robot out of an object's area."""
        return next((r for r in self.my_rules() if r.object_name == name), None)

    def rule_at(self, point: Point) -> AreaRule | None:
        """Return a rule whose area holds this point."""
        return next((r for r in self.my_rules() if r.centre.distance(point) < r.radius_m), None)
