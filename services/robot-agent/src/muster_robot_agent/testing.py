"""A whole site in one loop without a wall clock: kinematic machines, their skills, and what they tell each other.

For tests and measurements of skills and navigation. Time passes as fast as it can be computed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from muster_schemas.base import Point, Pose
from muster_schemas.robot import RobotState, SkillRequest, TargetObject
from muster_schemas.site import Site, Thing
from muster_schemas.world import AreaRules, MapObject, ObjectSize

from .drivers.kinematic_world import STEP_S, KinematicWorld
from .machine import Machine
from .skills.execution import Outcome, SkillRun
from .surroundings import SiteView, Surroundings

BOOT_ID = "boot-test"


def map_object(thing: Thing) -> MapObject:
    """Return a thing of the site's file as the cameras would report it."""
    size = ObjectSize(length_m=2 * thing.radius_m, width_m=2 * thing.radius_m)
    return MapObject.model_validate(
        {
            "name": thing.name,
            "class": thing.object_class,
            "position": thing.position,
            "size": size,
            "confidence": 1.0,
            "seen_at": 0.0,
        }
    )


def target(thing: MapObject) -> TargetObject:
    """Return an object as a request names it."""
    return TargetObject(
        name=thing.name, object_class=thing.object_class, position=thing.position, radius_m=thing.radius_m
    )


def request(robot_id: str, skill: str, **rest: object) -> SkillRequest:
    """Return a start of a skill; `rest` overrides any field."""
    fields: dict[str, object] = {
        "mission_id": "m-1",
        "task_id": "t1",
        "attempt": 1,
        "epoch": 1,
        "robot_id": robot_id,
        "boot_id": BOOT_ID,
        "skill": skill,
        "issued_at": 0.0,
        "deadline": 4e9,
        **rest,
    }
    return SkillRequest.model_validate(fields)


@dataclass
class Crew:
    """Some robots of a site, each with its machine and at most one skill under way."""

    site: Site
    robot_ids: Sequence[str]
    states_every_s: float = 0.2
    """How old the others' states may become, in site time."""
    runs: dict[str, SkillRun] = field(default_factory=dict[str, SkillRun])
    outcomes: dict[str, Outcome] = field(default_factory=dict[str, Outcome])
    tracks: dict[str, list[Pose]] = field(default_factory=dict[str, list[Pose]])
    smallest_gap_m: float = math.inf
    """The least distance that two hulls ever had; 0 once they touched."""

    def __post_init__(self) -> None:
        self.world = KinematicWorld(self.site, self.robot_ids)
        self.view = SiteView(self.site, objects={t.name: map_object(t) for t in self.site.things})
        self.machines: dict[str, Machine] = {}
        for robot_id in self.robot_ids:
            entry = next(r for r in self.site.robots if r.id == robot_id)
            around = Surroundings(self.view, robot_id)
            card = self.site.card(robot_id, BOOT_ID)
            kind = self.site.robot_types[entry.type]
            self.machines[robot_id] = Machine(card, kind, around, self.world.telemetry(robot_id))
            self.tracks[robot_id] = []
        self._share_states()
        self._next_states = 0.0

    def stand(self, robot_id: str, x: float, y: float, yaw: float = 0.0) -> None:
        """Put a robot somewhere else before anything begins."""
        self.world.robots[robot_id].pose = Pose(x=x, y=y, yaw=yaw)
        self.machines[robot_id].sense(self.world.telemetry(robot_id))
        self._share_states()

    def obey(self, rules: AreaRules) -> None:
        """Publish area rules to every robot."""
        self.view.rules = rules

    def start(self, robot_id: str, skill: str, **rest: object) -> SkillRun:
        """Start a skill on a robot."""
        run = SkillRun(self.machines[robot_id], request(robot_id, skill, **rest))
        self.runs[robot_id] = run
        self.outcomes.pop(robot_id, None)
        return run

    def drive(self, robot_id: str, x: float, y: float, yaw: float = 0.0) -> SkillRun:
        """Start a drive to a pose."""
        return self.start(robot_id, "target_area_for_specific_robots", goals=[Pose(x=x, y=y, yaw=yaw)])

    def step(self) -> None:
        """Let one step of site time pass for everyone."""
        self.world.advance()
        if self.world.time_s >= self._next_states:
            self._next_states = self.world.time_s + self.states_every_s
            self._share_states()
        for robot_id, machine in self.machines.items():
            telemetry = self.world.telemetry(robot_id)
            run = self.runs.get(robot_id)
            if run is None:
                machine.sense(telemetry)
                continue
            self.world.command(robot_id, run.step(telemetry))
            if run.outcome is not None:
                self.outcomes[robot_id] = run.outcome
                del self.runs[robot_id]
        for robot_id, robot in self.world.robots.items():
            self.tracks[robot_id].append(robot.pose)
        self._measure()

    def run(self, limit_s: float = 600.0) -> dict[str, Outcome]:
        """Let time pass until every skill has ended, or the limit; return the outcomes."""
        ends_at = self.world.time_s + limit_s
        while self.runs and self.world.time_s < ends_at:
            self.step()
        return self.outcomes

    def wait(self, seconds: float) -> None:
        """Let this much site time pass."""
        for _ in range(round(seconds / STEP_S)):
            self.step()

    def _share_states(self) -> None:
        for robot_id, machine in self.machines.items():
            body = self.world.robots[robot_id]
            self.view.states[robot_id] = RobotState(
                robot_id=robot_id,
                boot_id=BOOT_ID,
                seq=0,
                pose=body.pose,
                speed_mps=body.speed,
                load=self.world.telemetry(robot_id).load,
                path=machine.path,
                rules_revision=machine.surroundings.rules.revision,
                at=0.0,
            )

    def _measure(self) -> None:
        bodies = list(self.world.robots.values())
        for number, one in enumerate(bodies):
            for other in bodies[number + 1 :]:
                if one.pose.distance(other.pose) < 8.0:
                    corners = _corners(one.pose, one.type.length_m, one.type.width_m)
                    gap = _hull_gap(corners, _corners(other.pose, other.type.length_m, other.type.width_m))
                    self.smallest_gap_m = min(self.smallest_gap_m, gap)


def _corners(pose: Pose, length: float, width: float) -> list[Point]:
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return [
        Point(
            x=pose.x + a * length / 2 * cos - b * width / 2 * sin, y=pose.y + a * length / 2 * sin + b * width / 2 * cos
        )
        for a, b in signs
    ]


def _hull_gap(one: list[Point], other: list[Point]) -> float:
    """Return the distance of two convex hulls along the best separating side; 0 if they overlap."""
    best = -math.inf
    for first, second in ((one, other), (other, one)):
        for a, b in zip(first, [*first[1:], first[0]], strict=True):
            # corners run counter-clockwise, so outward is to the right of each side
            nx, ny = b.y - a.y, a.x - b.x
            norm = math.hypot(nx, ny)
            best = max(best, min(((p.x - a.x) * nx + (p.y - a.y) * ny) / norm for p in second))
    return max(best, 0.0)
