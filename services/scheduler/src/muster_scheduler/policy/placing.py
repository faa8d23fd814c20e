"""What each robot of a task is told: where to stand, with whom, which rules. Turns a startable task into a decision."""

from collections.abc import Iterator, Sequence

from muster_schemas.base import Point, Pose
from muster_schemas.robot import RobotCard, TargetObject
from muster_schemas.world import AreaRule

from muster_scheduler.core.events import Order, TaskBlocked, TaskDispatched, TaskImpossible
from muster_scheduler.core.rules import forbids
from muster_scheduler.core.state import Mission, Robot, State, Task
from muster_scheduler.partners import partners_of
from muster_scheduler.slots import Disc, Machine, place, stands_right

from .world import World

RULE_MARGIN_M = 1.0
"""A rule's circle is so much larger than its object."""
NEAR_M = 15.0
"""Robots that the plan sends nowhere work together if they stand this near."""

Decision = TaskDispatched | TaskBlocked | TaskImpossible


class _NoRoomError(Exception):
    pass


class _ForbiddenError(Exception):
    pass


def decide_start(state: State, world: World, task: Task, at: float) -> Decision:
    """Return the decision to start a task whose robots are free and whose objects are on the map."""
    mission = state.missions[task.mission_id]
    targets = tuple(_target(world, name) for name in task.objects if name in world.objects)
    if task.is_rule:
        return _rule(state, task, targets, at)
    trucks = frozenset(r for r, robot in state.robots.items() if _is_truck(robot.card))
    partners: dict[str, str] = {}
    if task.skill.verb in ("dump", "load"):
        partners = partners_of(mission, task, trucks, lambda a, b: _near(state, world, a, b))
    try:
        goals = _Places(state, world, mission, task, trucks, partners).goals(targets)
    except _NoRoomError as error:
        return TaskBlocked(at=at, mission_id=task.mission_id, task_id=task.task_id, waiting_for=str(error))
    except _ForbiddenError as error:
        return TaskImpossible(at=at, mission_id=task.mission_id, task_id=task.task_id, reason=str(error))
    return TaskDispatched(
        at=at,
        mission_id=task.mission_id,
        task_id=task.task_id,
        attempt=task.attempt + 1,
        orders=tuple(_order(state, r, goals.get(r, ()), partners.get(r)) for r in task.robots),
        objects=targets,
    )


def _order(state: State, robot_id: str, goals: tuple[Pose, ...] = (), partner: str | None = None) -> Order:
    boot_id = state.robots[robot_id].card.boot_id
    return Order(robot_id=robot_id, boot_id=boot_id, goals=goals, partner=partner)


def _rule(state: State, task: Task, targets: tuple[TargetObject, ...], at: float) -> TaskDispatched:
    avoids = task.skill.verb == "avoid"
    return TaskDispatched(
        at=at,
        mission_id=task.mission_id,
        task_id=task.task_id,
        attempt=task.attempt + 1,
        orders=tuple(_order(state, r) for r in task.robots),
        objects=targets,
        rules_added=tuple(
            AreaRule(robot_id=r, object_name=t.name, centre=t.position, radius_m=t.radius_m + RULE_MARGIN_M)
            for r in (task.robots if avoids else ())
            for t in targets
        ),
        rules_removed=tuple((r, name) for r in (() if avoids else task.robots) for name in task.objects),
    )


def _target(world: World, name: str) -> TargetObject:
    seen = world.objects[name]
    return TargetObject(
        name=name, object_class=seen.object_class, position=seen.position, radius_m=min(seen.radius_m, 1000.0)
    )


def _is_truck(card: RobotCard) -> bool:
    return "dump_loading" in card.skills


def _near(state: State, world: World, one: str, other: str) -> bool:
    robots = state.robots
    if one not in robots or other not in robots:
        return False
    return world.pose(robots[one].card).distance(world.pose(robots[other].card)) <= NEAR_M


class _Places:
    """Finds the places of all robots of one task, one after the other, diggers first."""

    def __init__(
        self, state: State, world: World, mission: Mission, task: Task, trucks: frozenset[str], partners: dict[str, str]
    ) -> None:
        self._state = state
        self._world = world
        self._mission = mission
        self._task = task
        self._trucks = trucks
        self._partners = partners
        self._types = {r.card.type for r in state.robots.values()}

    def goals(self, targets: Sequence[TargetObject]) -> dict[str, tuple[Pose, ...]]:
        """Return each robot's goals, one for each object in turn."""
        task = self._task
        cards = [self._state.robots[r].card for r in task.robots]
        if task.skill.verb == "home":
            return {c.robot_id: (c.home,) for c in cards}
        goals: dict[str, tuple[Pose, ...]] = {c.robot_id: () for c in cards}
        for target in targets:
            placed: dict[str, Pose] = {}
            for card in sorted(cards, key=lambda c: (c.robot_id in self._trucks, c.robot_id)):
                came_from = goals[card.robot_id][-1] if goals[card.robot_id] else self._world.pose(card)
                placed[card.robot_id] = self._goal(target, card, came_from, placed)
            goals = {r: (*g, placed[r]) for r, g in goals.items()}
        return goals

    def _goal(self, target: TargetObject, card: RobotCard, came_from: Pose, placed: dict[str, Pose]) -> Pose:
        disc = Disc(target.position, target.radius_m)
        rules = self._state.rules
        machine = Machine(
            robot_id=card.robot_id,
            pose=came_from,
            length_m=card.length_m,
            radius_m=card.radius_m,
            rear_first=card.robot_id in self._trucks,
            reach_m=card.reach_m,
            keep_out=tuple(Disc(r.centre, r.radius_m) for r in rules.avoided_by(card.robot_id)),
        )
        if self._task.skill.verb != "go" and stands_right(disc, machine):
            return came_from
        rule = forbids(rules, card.robot_id, target.name, target.position)
        if rule is not None:
            raise _ForbiddenError(
                f"{card.robot_id} must keep out of the area of {rule.object_name} (rule of {rule.radius_m:.1f} m), "
                f"so it cannot drive to {target.name}; allow the area first"
            )
        taken = [*self._things(target), *self._robots(placed)]
        pose = place(disc, machine, self._world.bounds, taken, self._beside(target, card, placed))
        if pose is None:
            raise _NoRoomError(f"room: a place for {card.robot_id} at {target.name}")
        return pose

    def _things(self, target: TargetObject) -> Iterator[Disc]:
        """Yield the other objects. The map also shows the robots; they say themselves where they are."""
        for thing in self._world.objects.values():
            if thing.name != target.name and thing.object_class not in self._types:
                yield Disc(thing.position, thing.radius_m)

    def _robots(self, placed: dict[str, Pose]) -> Iterator[Disc]:
        for robot_id, robot in self._state.robots.items():
            if robot_id in placed:
                yield Disc(placed[robot_id], robot.card.radius_m)
            elif robot_id not in self._task.robots:
                yield Disc(self._whereabouts(robot), robot.card.radius_m)

    def _whereabouts(self, robot: Robot) -> Pose:
        """Return where a robot will be: at the last goal of what it does, else where it stands."""
        task = self._state.task(robot.holder) if robot.holder else None
        run = task.runs.get(robot.card.robot_id) if task else None
        return run.order.goals[-1] if run and run.order.goals else self._world.pose(robot.card)

    def _beside(self, target: TargetObject, card: RobotCard, placed: dict[str, Pose]) -> list[Point]:
        """Return where those are that work with a robot at an object: its partner, else all of the other kind."""
        mission_robots = {r for t in self._mission.tasks.values() for r in t.robots}
        partner = self._partners.get(card.robot_id) or self._partner_to_come(card.robot_id)
        places: list[Point] = []
        for robot_id in sorted({partner} if partner else mission_robots):
            robot = self._state.robots.get(robot_id)
            if robot is None or (robot_id in self._trucks) == (card.robot_id in self._trucks):
                continue
            pose = placed.get(robot_id) or self._whereabouts(robot)
            if pose.distance(target.position) < target.radius_m + NEAR_M:
                places.append(pose)
        return places

    def _partner_to_come(self, robot_id: str) -> str | None:
        """Return whom the rest of the plan has a robot work with."""
        for task in self._mission.tasks.values():
            if task.skill.verb == "dump" and not task.state.ended:
                pairs = partners_of(self._mission, task, self._trucks, lambda _a, _b: False)
                for excavator, truck in pairs.items():
                    if robot_id in (excavator, truck):
                        return truck if robot_id == excavator else excavator
        return None
