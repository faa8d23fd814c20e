"""Driving: around things, out of closed areas, past each other, and honestly giving up. No wall clock."""

import math
import random

import pytest
from muster_robot_agent.kinematics import wrap
from muster_robot_agent.testing import Crew
from muster_schemas.base import Point
from muster_schemas.robot import SkillStatusKind
from muster_schemas.world import AreaRule, AreaRules

from .conftest import MakeCrew

E1, E2, T1 = "robot_excavator_01", "robot_excavator_02", "robot_dump_truck_01"
ALL = ("E1", "E2", "E3", "T1", "T2", "T3")


def block(x: float, y: float, radius: float = 1.0, name: str | None = None) -> dict[str, object]:
    """Return an obstacle."""
    return {
        "name": name or f"obstacle-{x:.0f}-{y:.0f}".replace("--", "-m"),
        "class": "obstacle",
        "position": {"x": x, "y": y},
        "radius_m": radius,
        "height_m": 1.0,
    }


def assert_all_succeeded(crew: Crew) -> None:
    """Check that every robot of the crew has done what it was asked."""
    failed = {r: o.reason for r, o in crew.outcomes.items() if o.state is not SkillStatusKind.SUCCEEDED}
    assert not failed
    assert not crew.runs
    assert len(crew.outcomes) == len(crew.machines)


def nearest(crew: Crew, robot_id: str, point: Point) -> float:
    """Return how near a robot's centre ever came to a point."""
    return min(pose.distance(point) for pose in crew.tracks[robot_id])


def test_a_drive_ends_at_the_asked_pose(crew: MakeCrew) -> None:
    """Within 0.3 m and 0.15 rad, standing still."""
    yard = crew("T1")
    yard.drive(T1, 20, -15, 2.0)
    yard.run()
    assert_all_succeeded(yard)
    pose = yard.machines[T1].pose
    assert pose.distance(Point(x=20, y=-15)) < 0.3
    assert abs(wrap(pose.yaw - 2.0)) < 0.15
    assert yard.machines[T1].still


def test_a_robot_goes_around_what_is_solid(crew: MakeCrew) -> None:
    """Soil, obstacles, rocks and things of unknown class are kept clear of by the hull."""
    for kind in ("soil", "obstacle", "rock", "statue"):
        yard = crew("E1", things=[{**block(-15, 14, 2.0), "class": kind}])
        yard.drive(E1, -2, 14)
        yard.run()
        assert_all_succeeded(yard)
        assert nearest(yard, E1, Point(x=-15, y=14)) > 2.0 + 1.25


def test_a_robot_drives_through_a_puddle(crew: MakeCrew) -> None:
    """Water is no obstacle: the straight way is taken."""
    yard = crew("E1", things=[{**block(-15, 14, 2.0), "class": "puddle"}])
    yard.drive(E1, -2, 14)
    yard.run()
    assert_all_succeeded(yard)
    assert nearest(yard, E1, Point(x=-15, y=14)) < 1.0


def test_a_closed_area_is_driven_around(crew: MakeCrew) -> None:
    """The same puddle under a rule is kept out of, with the whole hull; for another robot it stays open."""
    yard = crew("E1", "E2", things=[{**block(-15, 11, 2.0, "puddle1"), "class": "puddle"}])
    rule = AreaRule(robot_id=E1, object_name="puddle1", centre=Point(x=-15, y=11), radius_m=3.0)
    yard.obey(AreaRules(revision=1, rules=(rule,)))
    yard.stand(E1, -25, 11)
    yard.stand(E2, -25, -15)
    yard.drive(E1, -2, 11)
    yard.run()
    yard.stand(E2, -25, 11)
    yard.drive(E2, -8, 11)
    yard.run()
    assert_all_succeeded(yard)
    assert nearest(yard, E1, rule.centre) > 3.0 + 1.25
    assert nearest(yard, E2, rule.centre) < 1.0


def test_a_robot_inside_a_closed_area_may_leave_it(crew: MakeCrew) -> None:
    """A rule that closes the ground under a robot does not lock it in."""
    yard = crew("E1", things=[])
    yard.stand(E1, -10, 0)
    rule = AreaRule(robot_id=E1, object_name="puddle1", centre=Point(x=-9, y=0), radius_m=4.0)
    yard.obey(AreaRules(revision=1, rules=(rule,)))
    yard.drive(E1, -20, 0)
    yard.run()
    assert_all_succeeded(yard)


def test_a_robot_that_stands_too_near_to_something_may_move_away(crew: MakeCrew) -> None:
    """Standing within the usual clearance of an obstacle is no reason to stand there for ever."""
    yard = crew("E1", things=[block(-10, 0, 1.5)])
    yard.stand(E1, -12.9, 0, math.pi)
    yard.drive(E1, 10, 0)
    yard.run()
    assert_all_succeeded(yard)
    assert nearest(yard, E1, Point(x=-10, y=0)) > 2.6


def test_a_goal_inside_a_closed_area_is_given_up_with_the_reason(crew: MakeCrew) -> None:
    """The robot tries for a while, since rules change, and then names the area."""
    yard = crew("E1", things=[])
    rule = AreaRule(robot_id=E1, object_name="puddle1", centre=Point(x=0, y=0), radius_m=4.0)
    yard.obey(AreaRules(revision=1, rules=(rule,)))
    yard.drive(E1, 0, 0)
    outcome = yard.run()[E1]
    assert outcome.state is SkillStatusKind.FAILED
    assert "puddle1" in (outcome.reason or "")
    assert nearest(yard, E1, rule.centre) > 4.0


def test_a_robot_that_stands_on_the_goal_is_named(crew: MakeCrew) -> None:
    """Who waits in vain for a place says who stands there."""
    yard = crew("E1", "T1", things=[])
    yard.stand(T1, 0, 0)
    yard.drive(E1, 0.5, 0)
    outcome = yard.run()[E1]
    assert outcome.state is SkillStatusKind.FAILED
    assert T1 in (outcome.reason or "")
    assert yard.smallest_gap_m > 0


def test_a_walled_in_robot_says_that_there_is_no_way(crew: MakeCrew) -> None:
    """A ring without a gap cannot be left; nothing is touched."""
    ring = [block(8 * math.cos(a / 10 * math.tau), 8 * math.sin(a / 10 * math.tau), 1.0, f"o{a}") for a in range(10)]
    yard = crew("E1", things=ring)
    yard.stand(E1, 0, 0)
    yard.drive(E1, 20, 0)
    outcome = yard.run()[E1]
    assert outcome.state is SkillStatusKind.FAILED
    assert "no way around" in (outcome.reason or "")
    assert all(nearest(yard, E1, Point.model_validate(b["position"])) > 1.0 + 1.25 for b in ring)


def test_a_robot_waits_for_a_place_that_becomes_free(crew: MakeCrew) -> None:
    """Not reachable now is no failure: others move."""
    yard = crew("E1", "T1", things=[])
    yard.stand(T1, 0, 0)
    yard.drive(E1, 0, 0)
    yard.wait(40)
    assert E1 in yard.runs
    yard.drive(T1, 20, 0)
    yard.run()
    assert_all_succeeded(yard)


@pytest.mark.parametrize("states_every_s", [0.2, 0.6])
def test_crossing_robots_never_touch(crew: MakeCrew, states_every_s: float) -> None:
    """Four robots whose straight ways meet in one point all arrive."""
    yard = crew("E1", "E2", "T1", "T2", things=[], states_every_s=states_every_s)
    for robot_id, (x, y) in zip(yard.robot_ids, [(-15, 0), (0, -15), (15, 0), (0, 15)], strict=True):
        yard.stand(robot_id, x, y, math.atan2(-y, -x))
        yard.drive(robot_id, -x, -y)
    yard.run()
    assert_all_succeeded(yard)
    assert yard.smallest_gap_m > 0.1


def test_head_on_in_a_corridor_one_backs_out(crew: MakeCrew) -> None:
    """Where two cannot pass, the one that goes last makes way, and both arrive."""
    walls = [block(x, y, 1.2) for x in range(-10, 11, 2) for y in (-4.2, 4.2)]
    walls += [
        block(x, y, 1.5, f"end{x}-{abs(y)}{'n' if y > 0 else 's'}")
        for x in (-10, 10)
        for y in range(-22, 23, 3)
        if abs(y) > 5
    ]
    yard = crew("E1", "T1", things=walls)
    yard.stand(T1, -16, 0)
    yard.stand(E1, 16, 0, math.pi)
    yard.drive(T1, 22, 0)
    yard.drive(E1, -22, 0, math.pi)
    yard.run()
    assert_all_succeeded(yard)
    assert yard.smallest_gap_m > 0


def test_robots_that_swap_places_both_arrive(crew: MakeCrew) -> None:
    """Each stands on the other's goal."""
    yard = crew("E1", "T1", things=[])
    yard.stand(T1, 0, 0)
    yard.stand(E1, 5.5, 0)
    yard.drive(T1, 5.5, 0)
    yard.drive(E1, 0, 0)
    yard.run()
    assert_all_succeeded(yard)
    assert yard.smallest_gap_m > 0


@pytest.mark.parametrize("seed", [3, 6])
def test_six_robots_on_random_ways_arrive_and_never_touch(crew: MakeCrew, seed: int) -> None:
    """The default site, everyone driving at once, twice."""
    yard = crew(*ALL)
    rng = random.Random(seed)
    solid = [(o.position, o.radius_m) for o in yard.view.objects.values() if o.object_class != "puddle"]
    for _ in range(2):
        goals: list[Point] = []
        while len(goals) < len(yard.robot_ids):
            goal = Point(x=rng.uniform(-26, 26), y=rng.uniform(-18, 18))
            if all(goal.distance(p) > r + 2.8 for p, r in solid) and all(goal.distance(g) > 5.0 for g in goals):
                goals.append(goal)
        for robot_id, goal in zip(yard.robot_ids, goals, strict=True):
            yard.drive(robot_id, goal.x, goal.y, rng.uniform(-3, 3))
        yard.run()
        assert_all_succeeded(yard)
    assert yard.smallest_gap_m > 0
