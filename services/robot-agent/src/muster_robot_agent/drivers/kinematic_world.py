"""Machines that move by kinematics alone, in this process: unicycles with joints, and simple books of what is loaded.

Several machines share one world, so an excavator can dig in it and empty into a truck. Nothing is rigid here: what
must not be touched is the agents' business, and tests measure whether they keep it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from muster_schemas.base import Point, Pose
from muster_schemas.machines import DUMP_TRUCK, EXCAVATOR, JointLimit
from muster_schemas.robot import Load
from muster_schemas.sim import Telemetry
from muster_schemas.site import Bounds, RobotType, Site

from muster_robot_agent.kinematics import Joints, bed_centre, place, tip_place
from muster_robot_agent.machine import Order

STEP_S = 0.05
SOLID_CLASSES = frozenset({"obstacle", "rock"})
_GRASP_M = 0.35
_ACCELERATION = 2.0
_TURN_ACCELERATION = 2.5
_AT_REST_RAD = 1e-9


@dataclass
class Heap:
    """Soil on the ground, as a cone."""

    at: Point
    radius_m: float
    height_m: float
    soil_m3: float

    def surface_m(self, point: Point) -> float:
        """Return how high the soil stands at a place."""
        return self.height_m * max(0.0, 1 - self.at.distance(point) / self.radius_m) if self.soil_m3 > 0 else 0.0


@dataclass
class Thing:
    """Something solid that a bucket can pick up; None as its place while it is carried."""

    name: str
    radius_m: float
    height_m: float
    at: Point | None


@dataclass
class Body:
    """One machine's state."""

    robot_id: str
    type: RobotType
    pose: Pose
    limits: dict[str, JointLimit]
    joints: Joints
    speed: float = 0.0
    turn: float = 0.0
    soil_m3: float = 0.0
    things: list[Thing] = field(default_factory=list[Thing])
    order: Order = field(default_factory=Order)
    order_ends_s: float = 0.0
    open: bool = False
    bite: tuple[Point, float] | None = None
    """Where the tip was deepest in the soil during this curl, and how deep."""
    grasped: Thing | None = None


class KinematicWorld:
    """The machines of some robots of a site, and its soil and solid things."""

    def __init__(self, site: Site, robot_ids: Sequence[str]) -> None:
        self.time_s = 0.0
        self.bounds: Bounds = site.bounds
        self._timeout_s = site.command_timeout_s
        self._seq = 0
        self.heaps = [
            Heap(t.position, t.radius_m, t.height_m, t.soil_m3) for t in site.things if t.object_class == "soil"
        ]
        self.things = [
            Thing(t.name, t.radius_m, t.height_m, t.position) for t in site.things if t.object_class in SOLID_CLASSES
        ]
        self._awake: dict[str, Body] = {}
        """Machines that something may change at the next step; the others cost nothing."""
        self.robots: dict[str, Body] = {}
        for entry in site.robots:
            if entry.id in robot_ids:
                self.robots[entry.id] = _body(entry.id, site.robot_types[entry.type], entry.home)

    def command(self, robot_id: str, order: Order) -> None:
        """Take an order; it holds until the next one or the command timeout."""
        robot = self.robots[robot_id]
        robot.order = Order(order.speed_mps, order.turn_radps, {**robot.order.joints, **order.joints})
        robot.order_ends_s = self.time_s + self._timeout_s
        self._awake[robot_id] = robot

    def telemetry(self, robot_id: str) -> Telemetry:
        """Return what a machine senses now."""
        robot = self.robots[robot_id]
        return Telemetry(
            robot_id=robot_id,
            seq=self._seq,
            site_time_s=self.time_s,
            pose=robot.pose,
            speed_mps=robot.speed,
            turn_radps=robot.turn,
            joints=dict(robot.joints),
            load=Load(soil_m3=robot.soil_m3, bodies=tuple(t.name for t in robot.things)),
        )

    def advance(self) -> list[str]:
        """Let one step of site time pass; return the machines that it may have changed."""
        self.time_s += STEP_S
        self._seq += 1
        awake = list(self._awake.values())
        self._awake.clear()
        for robot in awake:
            if not self._move(robot):
                self._awake[robot.robot_id] = robot
            if robot.type.body == "excavator":
                self._work_bucket(robot)
            elif robot.type.body == "dump_truck" and robot.joints["bed"] > DUMP_TRUCK.empties_above_rad:
                self._drop(robot, place(robot.pose, DUMP_TRUCK.drop_x_m))
        return [robot.robot_id for robot in awake]

    def _move(self, robot: Body) -> bool:
        """Move tracks and joints by one step; return whether the machine is at rest, as its order wants it."""
        in_time = self.time_s <= robot.order_ends_s
        order = robot.order if in_time else Order()
        kind = robot.type
        speed = min(max(order.speed_mps, -kind.max_speed_mps), kind.max_speed_mps)
        turn = min(max(order.turn_radps, -kind.max_turn_radps), kind.max_turn_radps)
        robot.speed += _cut(speed - robot.speed, _ACCELERATION * STEP_S)
        robot.turn += _cut(turn - robot.turn, _TURN_ACCELERATION * STEP_S)
        yaw = robot.pose.yaw + robot.turn * STEP_S / 2
        robot.pose = Pose(
            x=robot.pose.x + robot.speed * STEP_S * math.cos(yaw),
            y=robot.pose.y + robot.speed * STEP_S * math.sin(yaw),
            yaw=math.remainder(robot.pose.yaw + robot.turn * STEP_S, math.tau),
        )
        if not in_time:
            robot.order = Order(joints=dict(robot.joints))
        at_rest = not (speed or turn or robot.speed or robot.turn)
        for name, limit in robot.limits.items():
            wanted = min(max(robot.order.joints.get(name, robot.joints[name]), limit.low), limit.high)
            at_rest = at_rest and abs(wanted - robot.joints[name]) < _AT_REST_RAD
            robot.joints[name] += _cut(wanted - robot.joints[name], limit.speed_radps * STEP_S)
        return at_rest

    def _work_bucket(self, robot: Body) -> None:
        angle = robot.joints["bucket"]
        if angle > EXCAVATOR.releases_above_rad:
            if not robot.open:
                robot.open = True
                self._release(robot)
            robot.bite = robot.grasped = None
            return
        if not robot.open:
            return
        tip, height = tip_place(robot.pose, robot.joints)
        for thing in self.things:
            within = thing.at is not None and thing.at.distance(tip) <= thing.radius_m + _GRASP_M
            if within and height <= thing.height_m and not robot.things and robot.soil_m3 == 0:
                robot.grasped = thing
        depth = max((h.surface_m(tip) for h in self.heaps), default=0.0) - height
        if depth > 0 and (robot.bite is None or depth > robot.bite[1]):
            robot.bite = (tip, depth)
        if angle <= EXCAVATOR.holds_below_rad:
            robot.open = False
            self._fill(robot)

    def _fill(self, robot: Body) -> None:
        if robot.grasped is not None:
            robot.grasped.at = None
            robot.things.append(robot.grasped)
        elif robot.bite is not None and not robot.things:
            room = robot.type.capacity_m3 - robot.soil_m3
            heap = max(self.heaps, key=lambda h: h.surface_m(robot.bite[0] if robot.bite else h.at), default=None)
            if heap is not None and heap.surface_m(robot.bite[0]) > 0:
                room = min(room, heap.soil_m3)
                heap.soil_m3 -= room
            robot.soil_m3 += room

    def _release(self, robot: Body) -> None:
        joints = robot.joints
        forward = [f(joints) for f in (_tip_forward, _joint_forward)]
        at = place(Pose(x=robot.pose.x, y=robot.pose.y, yaw=robot.pose.yaw + joints["swing"]), sum(forward) / 2)
        for truck in self.robots.values():
            if truck.type.body != "dump_truck" or bed_centre(truck.pose).distance(at) > DUMP_TRUCK.bed_width_m / 2:
                continue
            taken = min(robot.soil_m3, max(truck.type.capacity_m3 - truck.soil_m3, 0.0))
            truck.soil_m3 += taken
            robot.soil_m3 -= taken
            truck.things += robot.things
            robot.things = []
            self._awake[truck.robot_id] = truck  # its bed may be up
        self._drop(robot, at)

    def _drop(self, robot: Body, at: Point) -> None:
        if robot.soil_m3 > 0:
            radius = (1.6 * robot.soil_m3) ** (1 / 3)
            self.heaps.append(Heap(at, radius, 0.6 * radius, robot.soil_m3))
        for thing in robot.things:
            thing.at = at
        robot.soil_m3, robot.things = 0.0, []


def _body(robot_id: str, kind: RobotType, home: Pose) -> Body:
    if kind.body == "excavator":
        rest = {"swing": 0.0, "boom": 0.8, "arm": -2.2, "bucket": -1.2}
        return Body(robot_id, kind, home, EXCAVATOR.joints, rest)
    if kind.body == "dump_truck":
        return Body(robot_id, kind, home, DUMP_TRUCK.joints, {"bed": 0.0})
    return Body(robot_id, kind, home, {}, {})


def _tip_forward(joints: Joints) -> float:
    return EXCAVATOR.bucket_tip(joints["boom"], joints["arm"], joints["bucket"])[0]


def _joint_forward(joints: Joints) -> float:
    return EXCAVATOR.bucket_joint(joints["boom"], joints["arm"])[0]


def _cut(value: float, most: float) -> float:
    return min(max(value, -most), most)
