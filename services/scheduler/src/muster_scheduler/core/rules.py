"""Area rules: who keeps out of what. They add up per robot and hold until they are lifted."""

from collections.abc import Collection

from muster_schemas.base import Point
from muster_schemas.world import AreaRule, AreaRules


def with_rules(rules: AreaRules, added: Collection[AreaRule], removed: Collection[tuple[str, str]]) -> AreaRules:
    """Return the rules of the next revision. A rule for the same robot and object replaces the one before.

    Args:
        rules: that hold now.
        added: new ones.
        removed: (robot, object) of those that are lifted.

    """
    by_pair = {(r.robot_id, r.object_name): r for r in rules.rules}
    for pair in removed:
        by_pair.pop(pair, None)
    by_pair |= {(r.robot_id, r.object_name): r for r in added}
    return AreaRules(revision=rules.revision + 1, rules=tuple(by_pair[p] for p in sorted(by_pair)))


def forbids(rules: AreaRules, robot_id: str, object_name: str, centre: Point) -> AreaRule | None:
    """Return the rule that keeps a robot from driving to an object: about the object itself, or around its centre."""
    for rule in rules.avoided_by(robot_id):
        if rule.object_name == object_name or rule.centre.distance(centre) < rule.radius_m:
            return rule
    return None
