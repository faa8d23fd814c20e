"""Which robots a selector such as "two trucks" means: a minimum-cost matching over all that is open at once.

The nearest able robots; those that work for others later; those that the plan names elsewhere last.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

from muster_schemas.robot import RobotCard
from scipy import optimize  # pyright: ignore[reportMissingTypeStubs]

from muster_scheduler.core.events import SelectorBound
from muster_scheduler.core.state import Mission, Presence, Selector, State, Task

from .world import World

BUSY_COST = 1e4
ELSEWHERE_COST = 1e6
FORBIDDEN_COST = 1e9
"""Metres; each outweighs any sum of the ones before."""
PATIENCE_S = 60.0
"""After waiting so long a selector takes robots that are busy, and its task their next free moment."""


@dataclass(frozen=True, slots=True)
class _Demand:
    task: Task
    mission: Mission
    selector: Selector
    robot_types: tuple[str, ...]
    """One entry for each robot that is wanted."""


def bind(state: State, world: World, tasks: Sequence[Task], taken: set[str], at: float) -> list[SelectorBound]:
    """Return the selectors that can be bound now.

    Args:
        state: of the core.
        world: positions.
        tasks: ready ones whose selector is open, most urgent first.
        taken: robots that were given away just now.
        at: the time now.

    """
    bound: list[SelectorBound] = []
    demands: dict[tuple[str, str], _Demand] = {}
    for task in tasks:
        selector = task.selector
        mission = state.missions[task.mission_id]
        if selector is None or selector.name in mission.bound or (task.mission_id, selector.name) in demands:
            continue
        if selector.count is None:
            robots = everyone(state, mission, selector)
            if robots:
                bound.append(_event(task, selector, robots, at))
        else:
            wanted = tuple(t for t in selector.types for _ in range(selector.count))
            demands[task.mission_id, selector.name] = _Demand(task, mission, selector, wanted)
    return bound + _match(state, world, list(demands.values()), taken, at)


def _event(task: Task, selector: Selector, robots: Sequence[str], at: float) -> SelectorBound:
    return SelectorBound(at=at, mission_id=task.mission_id, selector=selector.name, robots=tuple(robots))


def everyone(state: State, mission: Mission, selector: Selector) -> list[str]:
    """Return all robots of the types; none while some have not been heard of since the start."""
    robots = [r for r in state.robots.values() if not selector.types or r.card.type in selector.types]
    robots = [r for r in robots if able(mission, selector, r.card)]
    if any(r.presence is Presence.UNSEEN for r in robots):
        return []
    return sorted(r.card.robot_id for r in robots if r.presence is Presence.ONLINE)


def wanted_elsewhere(mission: Mission, selector: Selector) -> frozenset[str]:
    """Return the robots that the plan means by a name or by another selector: this one hardly means them, too."""
    others = {r for name, bound in mission.bound.items() if name != selector.name for r in bound}
    return mission.named | others


def able(mission: Mission, selector: Selector, card: RobotCard) -> bool:
    """Return whether a robot has all the skills that the mission wants of a selector, and has not failed it."""
    if card.robot_id in mission.barred.get(selector.name, ()):
        return False
    skills = {t.skill.name for t in mission.tasks.values() if t.selector == selector}
    return skills <= set(card.skills)


def _match(
    state: State, world: World, demands: Sequence[_Demand], taken: set[str], at: float
) -> list[SelectorBound]:  # fmt: skip
    if not demands:
        return []
    types = {t for d in demands for t in d.robot_types}
    robots = [r for r in state.robots.values() if r.in_service and r.card.type in types]
    supply = {t: sum(r.card.type == t for r in robots) for t in types}
    admitted: list[_Demand] = []
    for demand in demands:
        wanted = {t: demand.robot_types.count(t) for t in demand.robot_types}
        if all(supply[t] >= n for t, n in wanted.items()):
            admitted.append(demand)
            supply |= {t: supply[t] - n for t, n in wanted.items()}
    rows = [(d, t) for d in admitted for t in d.robot_types]
    if not rows:
        return []
    cards = [r.card for r in robots]
    free = {r.card.robot_id for r in robots if r.free} - taken
    costs = [_costs(world, demand, robot_type, cards, free) for demand, robot_type in rows]
    chosen = cast("tuple[Sequence[int], Sequence[int]]", cast("Any", optimize).linear_sum_assignment(costs))
    picked: dict[int, list[tuple[str, float]]] = {}
    for row, column in zip(*chosen, strict=True):
        picked.setdefault(id(rows[row][0]), []).append((cards[column].robot_id, costs[row][column]))
    bound: list[SelectorBound] = []
    for demand in admitted:
        team = picked.get(id(demand), [])
        patient = at - (demand.task.ready_at or at) < PATIENCE_S
        worst = max((cost for _, cost in team), default=FORBIDDEN_COST)
        busy = any(robot_id not in free for robot_id, _ in team)
        if worst < FORBIDDEN_COST and not (busy and patient):
            bound.append(_event(demand.task, demand.selector, sorted(r for r, _ in team), at))
    return bound


def _costs(
    world: World, demand: _Demand, robot_type: str, cards: Sequence[RobotCard], free: set[str]
) -> list[float]:  # fmt: skip
    """Return the cost of each robot for one place in a demand, in metres."""
    mission = demand.mission
    elsewhere = wanted_elsewhere(mission, demand.selector)
    target = world.objects.get(demand.task.objects[0]) if demand.task.objects else None
    costs: list[float] = []
    for card in cards:
        unfit = card.type != robot_type or card.robot_id in demand.task.named
        if unfit or not able(mission, demand.selector, card):
            costs.append(FORBIDDEN_COST)
            continue
        travel = world.pose(card).distance(target.position) if target else 0.0
        costs.append(
            travel + BUSY_COST * (card.robot_id not in free) + ELSEWHERE_COST * (card.robot_id in elsewhere)
        )  # fmt: skip
    return costs
