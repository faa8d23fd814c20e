"""Which of the site's approval rules apply to a plan. Pure; what comes of it stands in the event with the plan."""

from collections.abc import Collection, Iterable, Sequence

from muster_schemas.plan import PlanTask
from muster_schemas.policies import ApprovalRule, AskForAllRobots, AskForManyRobots, AskForSkill
from muster_schemas.robot import RobotCard
from muster_schemas.skills import Catalogue

from muster_scheduler.core.state import RULE_VERBS


def why_ask(
    rules: Iterable[ApprovalRule], plan: Sequence[PlanTask], roster: Collection[RobotCard], catalogue: Catalogue
) -> tuple[str, ...]:
    """Return a sentence for each rule that wants a person to see the plan.

    Args:
        rules: of the site.
        plan: that has passed the gate.
        roster: the robots of the site.
        catalogue: its skills.

    """
    moved = _robots_moved(plan, roster, catalogue)
    skills = {catalogue.canonical(t.instruction_function.name) for t in plan}
    reasons: list[str] = []
    for rule in rules:
        match rule:
            case AskForAllRobots() if roster and moved >= len(roster):
                reasons.append(f"Site policy: it moves all {len(roster)} robots of the site.")
            case AskForManyRobots() if moved > rule.robots:
                reasons.append(f"Site policy: it moves {moved} robots, more than {rule.robots}.")
            case AskForSkill() if catalogue.canonical(rule.skill) in skills:
                reasons.append(f"Site policy: it uses {rule.skill}.")
            case _:
                pass
    return tuple(reasons)


def _robots_moved(plan: Sequence[PlanTask], roster: Collection[RobotCard], catalogue: Catalogue) -> int:
    """Return how many robots a plan moves, at most; keeping out of an area moves nobody."""
    named: set[str] = set()
    chosen: dict[tuple[tuple[str, ...], int], int] = {}
    for task in plan:
        function = task.instruction_function
        skill = catalogue[function.name]
        if skill.verb in RULE_VERBS:
            continue
        if skill.fleet_wide:
            return len(roster)
        named |= set(function.robot_ids)
        if isinstance(function.robot_count, int):
            chosen[function.robot_type, function.robot_count] = function.robot_count * len(function.robot_type)
        else:
            named |= {c.robot_id for c in roster if c.type in function.robot_type}
    return min(len(named) + sum(chosen.values()), len(roster))
