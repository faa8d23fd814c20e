"""One drive to one pose: plans, follows, makes way, plans anew when blocked, and gives up with a reason."""

import math
from collections.abc import Collection

import numpy as np
from muster_schemas.base import Point, Pose
from muster_schemas.robot import RobotState
from numpy.typing import NDArray

from muster_robot_agent.kinematics import wrap
from muster_robot_agent.machine import Machine, SkillFailedError

from . import traffic
from .controller import PathFollower, dense, distances_along, turn_towards
from .costmap import Circle, CostMap, Points, fitted
from .planner import find_path, find_way_out
from .traffic import Neighbour

ARRIVED_M = 0.15
NEAR_ENOUGH_M = 0.28
ALIGNED_RAD = 0.06
PATIENCE_S = 90.0
"""Site time without getting nearer after which a drive fails."""
LOOK_S = 0.2
CHECK_S = 1.0
REPLAN_S = 0.5
BLOCKED_S = 3.0
HOPELESS_S = 5.0
"""How often a way is looked for where there was none."""
STEP_ASIDE_AFTER_S = 8.0
SIGHT_M = 80.0
"""Robots farther away than this are looked at when they come nearer."""
KEEP_BACK_M = 2.0
"""How far from a robot that stands on the goal this one waits until it has gone."""


class Navigator:
    """Drives one machine to one pose. `step` is called at each telemetry and asks the machine for motion."""

    def __init__(self, machine: Machine, goal: Pose, destination: str) -> None:
        self._machine = machine
        self._goal = goal
        self._destination = destination
        self._follower: PathFollower | None = None
        self._neighbours: list[Neighbour] = []
        self._making_way = False
        self._aligning = False
        self._stop_at_m = math.inf
        self._waits_for: str | None = None
        self._no_path_because: str | None = None
        now = machine.now
        self._next_look = self._next_check = self._next_plan = now
        self._moved_at = self._gained_at = now
        self._moved_from: Point = machine.pose
        self._distance = machine.pose.distance(goal)
        self._nearest = math.inf

    @property
    def progress(self) -> float:
        """Share of the straight way that lies behind."""
        return 1 - min(self._machine.pose.distance(self._goal) / max(self._distance, 0.1), 1.0)

    def step(self) -> bool:
        """Ask for the next motion; return whether the machine stands at the goal.

        Raises:
            SkillFailedError: no way was found for so long that somebody must be told why.

        """
        machine = self._machine
        if self._at_goal():
            machine.path = ()
            error = wrap(self._goal.yaw - machine.pose.yaw)
            if abs(error) <= ALIGNED_RAD:
                return machine.still
            machine.drive(0.0, turn_towards(error, machine.type.max_turn_radps))
            return False
        if machine.now >= self._next_look:
            self._next_look = machine.now + LOOK_S
            self._look()
        self._watch_patience()
        if self._follower is None or (self._making_way and self._follower.remaining < 0.3):
            machine.path = ()
            return False
        stop_within = self._stop_at_m - (self._follower.length - self._follower.remaining)
        speed, turn = self._follower.steer(machine.pose, stop_within)
        safe, body = traffic.safe_speed(machine.pose, speed, self._follower.remaining, self._neighbours)
        if body is not None:
            self._waits_for = body.robot_id
        # slower on the same curve
        machine.drive(safe, turn * safe / speed if speed else turn)
        return False

    def _at_goal(self) -> bool:
        pose, goal = self._machine.pose, self._goal
        distance = pose.distance(goal)
        passed = (goal.x - pose.x) * math.cos(pose.yaw) + (goal.y - pose.y) * math.sin(pose.yaw) <= 0.02
        if distance < ARRIVED_M or (distance < NEAR_ENOUGH_M and (passed or self._aligning)):
            self._aligning = True
        elif distance >= NEAR_ENOUGH_M:
            self._aligning = False
        return self._aligning

    def _look(self) -> None:
        """See where the others are, and decide whether to go on, wait, make way or plan anew."""
        machine, now = self._machine, self._machine.now
        self._neighbours = neighbours_of(machine)
        if machine.pose.distance(self._moved_from) > 0.3:
            self._moved_from, self._moved_at = machine.pose, now
            self._waits_for = None
        blocked = now - self._moved_at > BLOCKED_S
        if now >= self._next_plan and self._wants_plan(blocked=blocked):
            self._next_plan = now + (BLOCKED_S if blocked else REPLAN_S)
            self._plan(around_all=blocked)
        self._obey_traffic()
        self._publish_path()

    def _wants_plan(self, *, blocked: bool) -> bool:
        now = self._machine.now
        if self._follower is None or blocked:
            return True
        if self._making_way:
            return self._follower.remaining < 0.3
        if now < self._next_check:
            return False
        self._next_check = now + CHECK_S
        points, _ = self._follower.ahead(self._machine.pose, 12.0)
        # the first metre is left out: cells beside the robot may be taken while the way itself is fine
        return not self._map(around_all=False).free(points[2:-1]) if len(points) > 3 else False

    def _plan(self, *, around_all: bool) -> None:
        machine = self._machine
        grid = self._map(around_all=around_all)
        points = find_path(grid, machine.pose, self._goal)
        if points is None and around_all:
            grid = self._map(around_all=False)
            points = find_path(grid, machine.pose, self._goal)
        self._no_path_because = None if points is not None else self._blocker()
        if points is None:
            points = self._as_if_robots_left()
        if points is None:
            self._next_plan = machine.now + HOPELESS_S
            if self._follower is None or not self._making_way or self._follower.remaining < 0.3:
                self._follower, self._making_way = None, False
                self._step_aside()
            return
        follower = self._follow(points)
        if self._making_way:
            ahead, along = follower.ahead(machine.pose, traffic.LOOK_AHEAD_M)
            found = traffic.limit(ahead, along, machine.type.max_speed_mps, self._neighbours)
            if found.in_the_way or found.stop_within_m < 1.0:
                self._waits_for = found.because_of
                return
        self._making_way = False
        self._follower = follower

    def _as_if_robots_left(self) -> Points | None:
        """Return the path that there would be if no robot stood in it, for the others to see and make way.

        It ends a little before robots that stand where this one has to go.
        """
        grid = self._map(around_all=False, but={n.robot_id for n in self._neighbours})
        points = find_path(grid, self._machine.pose, self._goal)
        if points is None:
            return None
        self._no_path_because = None
        points, on_goal = dense(points), self._on_goal()
        if not on_goal:
            return points
        self._no_path_because = self._blocker()
        far = [np.hypot(points[:, 0] - n.at[0], points[:, 1] - n.at[1]) > n.clearance_m + KEEP_BACK_M for n in on_goal]
        free: NDArray[np.bool_] = np.all(far, axis=0)
        end = len(points) if free.all() else int(free.argmin())
        return points[:end] if end > 3 else None

    def _step_aside(self) -> None:
        """Leave for a while, since who stands on this robot's goal may wait for the place where this one stands.

        Only the one that goes last does so; it is no harm if the other stands there for good.
        """
        machine = self._machine
        if machine.now - self._moved_at < STEP_ASIDE_AFTER_S:
            return
        blockers = [n for n in self._on_goal() if n.goes_first]
        if not blockers:
            return
        grid = self._map(around_all=True)
        here = np.array([[machine.pose.x, machine.pose.y]])
        taken = grid.near(here, blockers[0].clearance_m + 1.0)
        for other in blockers:
            taken |= grid.near(other.path[:1], other.clearance_m + 2 * KEEP_BACK_M)
        if self._leave(grid, taken):
            self._next_plan = machine.now + STEP_ASIDE_AFTER_S

    def _leave(self, grid: CostMap, taken: NDArray[np.bool_]) -> bool:
        """Take the cheapest way to where nothing is taken; return whether there is one."""
        free = (~taken & np.isfinite(grid.cost)).ravel()
        way_out = find_way_out(grid, self._machine.pose, lambda cell: bool(free[cell]))
        if way_out is None or len(way_out) < 2:
            return False
        self._making_way = True
        self._follower = self._follow(way_out)
        return True

    def _on_goal(self) -> list[Neighbour]:
        goal = (self._goal.x, self._goal.y)
        return [n for n in self._neighbours if math.dist(n.at, goal) < n.clearance_m + 0.25]

    def _follow(self, points: Points) -> PathFollower:
        kind = self._machine.type
        return PathFollower(points, self._machine.pose, kind.max_speed_mps, kind.max_turn_radps)

    def _obey_traffic(self) -> None:
        self._stop_at_m = math.inf
        if self._follower is None or (self._making_way and self._follower.remaining < 0.3):
            # the other's path may have come nearer since this robot went out of its way
            self._make_way_if_asked(np.array([[self._machine.pose.x, self._machine.pose.y]]), np.zeros(1))
            return
        if self._making_way:
            if self._machine.now - self._moved_at > BLOCKED_S:
                # even the way out is closed: look for another one from here
                self._moved_at = self._machine.now
                self._make_way_if_asked(np.array([[self._machine.pose.x, self._machine.pose.y]]), np.zeros(1))
            return
        points, along = self._follower.ahead(self._machine.pose, traffic.LOOK_AHEAD_M)
        found = self._make_way_if_asked(points, along)
        if not self._making_way:
            if found.stop_within_m < 1.0:
                self._waits_for = found.because_of
            self._stop_at_m = self._follower.length - self._follower.remaining + found.stop_within_m

    def _make_way_if_asked(self, points: Points, along: Points) -> traffic.Limit:
        machine = self._machine
        found = traffic.limit(points, along, machine.type.max_speed_mps, self._neighbours)
        if not found.in_the_way:
            return found
        grid = self._map(around_all=True)
        taken = np.zeros(grid.cost.shape, dtype=np.bool_)
        for other in self._neighbours:
            if other.goes_first and other.driving:
                taken |= grid.near(other.path, other.clearance_m + 0.4)
        if self._leave(grid, taken):
            self._waits_for = found.because_of
            # who makes way for others begins anew
            self._nearest, self._gained_at = math.inf, machine.now
        return found

    def _publish_path(self) -> None:
        """Tell the others what is about to be driven: up to where this robot will wait, not beyond."""
        machine = self._machine
        if self._follower is None or (self._making_way and self._follower.remaining < 0.3):
            machine.path = ()
            return
        within = min(self._stop_at_m - (self._follower.length - self._follower.remaining), 60.0)
        if within < 0.3:
            machine.path = ()
            return
        points, _ = self._follower.ahead(machine.pose, within)
        thinned = np.concatenate([points[:-1:2], points[-1:]])
        machine.path = tuple(Point(x=round(float(x), 2), y=round(float(y), 2)) for x, y in thinned[:256])

    def _watch_patience(self) -> None:
        machine = self._machine
        left = self._follower.remaining if self._follower and not self._making_way else math.inf
        left = min(left, machine.pose.distance(self._goal) + 20)
        if left < self._nearest - 0.5:
            self._nearest, self._gained_at = left, machine.now
        if machine.now - self._gained_at > PATIENCE_S:
            because = self._no_path_because or (f"{self._waits_for} is in the way" if self._waits_for else None)
            raise SkillFailedError(
                f"could not reach {self._destination} for {PATIENCE_S:.0f} s: {because or 'the machine does not move'}"
            )

    def _map(self, *, around_all: bool, but: Collection[str] = ()) -> CostMap:
        machine, here, goal = self._machine, self._machine.pose, self._goal
        grid = CostMap(machine.surroundings.site.bounds, machine.card.radius_m, here, goal)
        robots = [c for c in self._robot_circles(around_all=around_all) if c.name not in but]
        circles = fitted([*ground_circles(machine), *robots], goal)
        grid.add(fitted([_soft(c) for c in circles], here))
        for other in self._neighbours:
            if other.goes_first and other.driving:
                taken = grid.near(other.path, other.clearance_m + 0.2)
                grid.cost[taken] += 3.0
        return grid

    def _robot_circles(self, *, around_all: bool) -> list[Circle]:
        circles: list[Circle] = []
        for other in self._neighbours:
            x, y = other.at
            stands = not other.driving or (around_all and abs(other.speed_mps) < 0.1)
            hard, firm = (other.clearance_m + 0.25, other.clearance_m + 0.1) if stands else (0.0, 0.0)
            soft = 0.75 if stands else other.clearance_m
            circles.append(Circle(other.robot_id, x, y, hard, soft_m=soft, firm_m=firm))
        return circles

    def _blocker(self) -> str:
        """Say what closes the way, for a person."""
        names = [
            c.name
            for c in fitted([*ground_circles(self._machine), *self._robot_circles(around_all=False)], self._goal)
            if c.distance(self._goal) < c.hard_m
        ]
        if names:
            return f"{', '.join(names)} stands too close to where it has to go"
        return "there is no way around what is in between"


def _soft(circle: Circle) -> Circle:
    """Return the circle without a firm core: whoever stands in it already must be able to leave."""
    return Circle(circle.name, circle.x, circle.y, circle.hard_m, circle.soft_m, circle.soft_cost)


def ground_circles(machine: Machine) -> list[Circle]:
    """Return what lies on the ground or is kept out of, as circles for the centre of this robot."""
    around, radius = machine.surroundings, machine.card.radius_m
    circles = [
        Circle(
            o.name,
            o.position.x,
            o.position.y,
            o.radius_m + radius + 0.2,
            firm_m=o.radius_m + machine.card.width_m / 2 + 0.1,
        )
        for o in around.solid_objects()
    ]
    circles += [
        Circle(
            f"the area around {r.object_name}, which it must avoid,",
            r.centre.x,
            r.centre.y,
            r.radius_m + radius + 0.1,
            firm_m=r.radius_m + machine.card.width_m / 2,
        )
        for r in around.my_rules()
    ]
    return circles


def neighbours_of(machine: Machine) -> list[Neighbour]:
    """Return the other robots in sight as traffic counts on them."""
    around, me = machine.surroundings, machine.card.robot_id
    near = (s for s in around.others.values() if s.pose.distance(machine.pose) < SIGHT_M)
    return [_neighbour(machine, state, goes_first=state.robot_id < me) for state in near]


def _neighbour(machine: Machine, state: RobotState, *, goes_first: bool) -> Neighbour:
    around = machine.surroundings
    kind = around.type_of(state.robot_id)
    here = np.array([[state.pose.x, state.pose.y]])
    path = here
    if len(state.path) > 1:
        path = _shortened(np.array([(p.x, p.y) for p in state.path], dtype=np.float64), here)
    return Neighbour(
        robot_id=state.robot_id,
        at=(state.pose.x, state.pose.y),
        speed_mps=state.speed_mps,
        path=path,
        clearance_m=machine.card.radius_m + around.radius_of(state.robot_id),
        goes_first=goes_first,
        max_speed_mps=kind.max_speed_mps if kind else 2.0,
    )


def _shortened(path: Points, here: Points) -> Points:
    """Return the path from where the robot is now, up to the horizon."""
    nearest = int(np.hypot(*(path - here).T).argmin())
    rest = np.concatenate([here, path[nearest + 1 :]])
    return rest[: int(np.searchsorted(distances_along(rest), traffic.HORIZON_M, side="right"))]
