"""The state that a site must be in after a mission, derived from the case's right plan, and what of it is not so.

The plan is played on paper, in an order that its dependencies allow: who is where, what is in which bucket and bed,
which piles lose soil, beside which objects soil lies afterwards, which things are gone, which rules hold. The
simulator's truth is then compared with that. Robots that a plan leaves open ("two trucks") may be any.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from muster_planner.evaluation.cases import Case
from muster_planner.evaluation.fleet import Fleet, type_of
from muster_schemas.base import Point
from muster_schemas.sim import SimBody, SimWorld
from muster_schemas.site import Site
from muster_schemas.world import AreaRules

HOME = "home"
SOIL = "soil"
NEAR_M = 10.0
"""A robot at an object stands no farther from its middle: places are given in rings around it."""
AT_HOME_M = 2.0
SOME_SOIL_M3 = 0.05
MOVED_M = 1.0
_PICKED_UP = frozenset({"obstacle", "rock"})


@dataclass(frozen=True)
class Step:
    """One task of the right plan, in one of the ways that a case allows."""

    key: str
    verb: str
    robots: tuple[str, ...]
    objects: tuple[str, ...]
    before: frozenset[str]


def steps_of(case: Case) -> list[Step]:
    """Return a case's tasks with places as far as the case knows them, each after those that it waits for."""
    before = {w.key: frozenset(a for a, b in case.before if b == w.key) for w in case.wanted}
    left = [
        Step(w.key, min(w.verbs), w.robots[0], max(w.objects, key=len), before[w.key])
        for w in case.wanted
        if not w.optional
    ]
    ordered: list[Step] = []
    while left:
        waiting = {s.key for s in left}
        ready = next((s for s in left if not s.before & waiting), left[0])
        ordered.append(ready)
        left.remove(ready)
    return ordered


@dataclass
class Goal:
    """What must be so in the end. Robots by id, or `dump_truck?0` where any of the type will do."""

    places: dict[str, str] = field(default_factory=dict[str, str])
    loads: dict[str, str | None] = field(default_factory=dict[str, str | None])
    dug: set[str] = field(default_factory=set[str])
    heaped: set[str] = field(default_factory=set[str])
    gone: set[str] = field(default_factory=set[str])
    rules: dict[tuple[str, str], bool] = field(default_factory=dict[tuple[str, str], bool])
    """(robot, object): whether the robot keeps out of it."""


def goal_of(case: Case, site: Site) -> Goal:
    """Return the goal of a case that has a plan, from a tidy site: robots at home, empty, no rules."""
    goal, steps = Goal(), steps_of(case)
    classes = {t.name: t.object_class for t in site.things}
    for step in steps:
        for robot in step.robots:
            _play(goal, step, robot, steps, classes)
    return goal


def _play(goal: Goal, step: Step, robot: str, steps: Sequence[Step], classes: Mapping[str, str]) -> None:
    if step.verb in ("avoid", "allow"):
        goal.rules |= {(robot, name): step.verb == "avoid" for name in step.objects}
        return
    goal.loads.setdefault(robot, None)
    if step.verb == "home":
        goal.places[robot] = HOME
        return
    if step.objects:
        goal.places[robot] = step.objects[-1]
    here = goal.places.setdefault(robot, HOME)
    held = goal.loads[robot]
    if step.verb == "dig" and held is None:
        picks_up = classes.get(here) in _PICKED_UP and here not in goal.gone
        goal.loads[robot] = here if picks_up else SOIL
        if picks_up:
            goal.gone.add(here)
        elif classes.get(here) == "soil":
            goal.dug.add(here)
    elif step.verb == "dump" and held is not None:
        truck = _truck_for(goal, step, here, steps)
        if truck:
            goal.loads[truck] = held
        elif held == SOIL:
            goal.heaped.add(here)
        goal.loads[robot] = None
    elif step.verb == "tip" and held is not None:
        if held == SOIL:
            goal.heaped.add(here)
        goal.loads[robot] = None


def _truck_for(goal: Goal, dump: Step, place: str, steps: Sequence[Step]) -> str | None:
    """Return the truck that a bucket is emptied into: there, empty, and loading beside it or waiting for it."""
    loads = [r for s in steps if s.verb == "load" and s.before == dump.before for r in s.robots]
    waiting = [r for s in steps if dump.key in s.before for r in s.robots]
    trucks = [r for s in steps if s.verb in ("load", "tip", "go", "home") for r in s.robots if "truck" in r]
    there = [r for r in (*loads, *waiting, *trucks) if r in trucks and goal.places.get(r) == place]
    return next((r for r in there if goal.loads.get(r) is None), next(iter(there), None))


def unmet(goal: Goal, site: Site, fleet: Fleet, before: SimWorld, after: SimWorld, rules: AreaRules) -> list[str]:
    """Return what is not as the goal has it, for the choice of open robots that comes nearest; empty if all is."""
    options = (_named(goal, chosen) for chosen in _choices(goal, fleet))
    return min((_differences(g, site, before, after, rules) for g in options), key=len)


def _choices(goal: Goal, fleet: Fleet) -> Iterator[dict[str, str]]:
    """Yield every way to give the open robots names of their own."""
    robots = sorted({*goal.places, *goal.loads, *(r for r, _ in goal.rules)})
    kinds = sorted({kind for r in robots if (kind := type_of(r))})
    named = {r for r in robots if not type_of(r)}
    each: list[list[dict[str, str]]] = []
    for kind in kinds:
        wanted = [r for r in robots if type_of(r) == kind]
        able = fleet.by_type.get(kind, ())
        free = [r for r in able if r not in named] if len(able) - len(named & set(able)) >= len(wanted) else list(able)
        each.append([dict(zip(wanted, p, strict=True)) for p in itertools.permutations(free, len(wanted))])
    for combination in itertools.product(*each):
        yield {old: new for part in combination for old, new in part.items()}


def _named(goal: Goal, names: Mapping[str, str]) -> Goal:
    return Goal(
        {names.get(r, r): place for r, place in goal.places.items()},
        {names.get(r, r): load for r, load in goal.loads.items()},
        goal.dug,
        goal.heaped,
        goal.gone,
        {(names.get(r, r), name): kept for (r, name), kept in goal.rules.items()},
    )


def _differences(goal: Goal, site: Site, before: SimWorld, after: SimWorld, rules: AreaRules) -> list[str]:
    things = {t.name: t.position for t in site.things}
    wrong: list[str] = []
    for robot in site.robots:
        place, body = goal.places.get(robot.id, HOME), after.robots[robot.id]
        if not _is_at(body.pose, place, robot.home, things):
            wrong.append(f"{robot.id} is not at {place}")
        if not _holds(body, goal.loads.get(robot.id)):
            wrong.append(f"{robot.id} holds {body.load}, not {goal.loads.get(robot.id)}")
    for name in sorted(things):
        wrong += _thing_differences(name, goal, before, after, things)
    held = {(r.robot_id, r.object_name) for r in rules.rules}
    asked = {pair for pair, kept in goal.rules.items() if kept}
    return wrong + [f"the rule {pair} {'is missing' if pair in asked else 'holds'}" for pair in sorted(held ^ asked)]


def _is_at(pose: Point, place: str, home: Point, things: Mapping[str, Point]) -> bool:
    if place == HOME:
        return pose.distance(home) <= AT_HOME_M
    return _nearest(pose, things) == place


def _nearest(at: Point, things: Mapping[str, Point]) -> str | None:
    """Return the object that something is at; None if none is near."""
    name = min(things, key=lambda n: at.distance(things[n]))
    return name if at.distance(things[name]) <= NEAR_M else None


def _holds(body: SimBody, wanted: str | None) -> bool:
    load = body.load
    if wanted is None:
        return load.soil_m3 < SOME_SOIL_M3 and not load.bodies
    return load.soil_m3 >= SOME_SOIL_M3 if wanted == SOIL else wanted in load.bodies


def _thing_differences(
    name: str, goal: Goal, before: SimWorld, after: SimWorld, things: Mapping[str, Point]
) -> Iterator[str]:
    pile = _pile(after, name) - _pile(before, name)
    around = _around(after, name, things) - _around(before, name, things)
    both = name in goal.dug and name in goal.heaped
    if name in goal.dug and not both and pile > -SOME_SOIL_M3:
        yield f"{name} has lost no soil"
    if name not in goal.dug and pile < -SOME_SOIL_M3:
        yield f"{name} has lost soil"
    if name in goal.heaped and not both and around < SOME_SOIL_M3:
        yield f"no soil was left at {name}"
    if name not in goal.heaped and around > SOME_SOIL_M3:
        yield f"soil was left at {name}"
    old, new = before.things.get(name), after.things.get(name)
    if old is not None:
        stays = new is not None and old.pose.distance(new.pose) < MOVED_M
        if stays and name in goal.gone:
            yield f"{name} is still there"
        if not stays and name not in goal.gone:
            yield f"{name} was moved"


def _pile(world: SimWorld, name: str) -> float:
    return sum(d.soil_m3 for d in world.soil if d.pile == name)


def _around(world: SimWorld, name: str, things: Mapping[str, Point]) -> float:
    return sum(d.soil_m3 for d in world.soil if _nearest(d.position, things) == name)
