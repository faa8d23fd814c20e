"""Skills in the kinematic machine: each is judged by its effect on the world, not by its own word. No wall clock."""

import math

import pytest
from muster_robot_agent.kinematics import bed_centre, wrap
from muster_robot_agent.skills.execution import SKILLS
from muster_robot_agent.testing import Crew, target
from muster_schemas.base import Point, Pose
from muster_schemas.robot import SkillStatusKind
from muster_schemas.skills import PAPER_SKILLS
from muster_schemas.world import AreaRule, AreaRules

from .conftest import MakeCrew

E1, T1, T2 = "robot_excavator_01", "robot_dump_truck_01", "robot_dump_truck_02"
DIG, DUMP, LOAD, TIP = "excavator_digging", "excavator_unloading", "dump_loading", "dump_unloading"
BESIDE_SOIL1 = Pose(x=-10, y=7, yaw=math.pi / 2)
TRUCK_BESIDE_SOIL1 = Pose(x=-15.2, y=8.5, yaw=-2.4)


def at_the_pile(crew: MakeCrew, *names: str) -> Crew:
    """Return a crew whose excavator stands at soil1, with a truck beside it if T1 is in it."""
    yard = crew(*names)
    yard.stand(E1, BESIDE_SOIL1.x, BESIDE_SOIL1.y, BESIDE_SOIL1.yaw)
    if T1 in yard.machines:
        yard.stand(T1, TRUCK_BESIDE_SOIL1.x, TRUCK_BESIDE_SOIL1.y, TRUCK_BESIDE_SOIL1.yaw)
    return yard


def do(yard: Crew, robot_id: str, skill: str, **rest: object) -> str | None:
    """Run a skill to its success; return the note that came with it."""
    yard.start(robot_id, skill, **rest)
    outcome = yard.run()[robot_id]
    assert outcome.state is SkillStatusKind.SUCCEEDED, outcome.reason
    return outcome.reason


def failure(yard: Crew, robot_id: str, skill: str, **rest: object) -> str:
    """Run a skill to its failure; return the reason."""
    yard.start(robot_id, skill, **rest)
    outcome = yard.run()[robot_id]
    assert outcome.state is SkillStatusKind.FAILED
    return outcome.reason or ""


def obj(yard: Crew, name: str) -> tuple[object, ...]:
    """Return an object of the map as a request has it."""
    return (target(yard.view.objects[name]),)


def test_every_skill_of_the_paper_can_be_done() -> None:
    """Twelve skills, no more and no fewer."""
    assert set(SKILLS) == {s.name for s in PAPER_SKILLS}


def test_digging_takes_soil_out_of_the_pile(crew: MakeCrew) -> None:
    """What is in the bucket is missing from the pile, and the bucket is held curled."""
    yard = at_the_pile(crew, "E1")
    do(yard, E1, DIG, objects=obj(yard, "soil1"))
    assert yard.machines[E1].load.soil_m3 == pytest.approx(0.5)
    assert sum(h.soil_m3 for h in yard.world.heaps) == pytest.approx(23.5)
    assert yard.machines[E1].telemetry.joints["bucket"] < -1.0


def test_digging_drives_to_an_object_that_is_out_of_reach(crew: MakeCrew) -> None:
    """Only then is the given slot used; without one the robot says so."""
    yard = crew("E1")
    reason = failure(yard, E1, DIG, objects=obj(yard, "soil1"))
    assert "soil1 is out of reach" in reason
    do(yard, E1, DIG, objects=obj(yard, "soil1"), goals=[BESIDE_SOIL1])
    assert yard.machines[E1].load.soil_m3 > 0
    assert yard.machines[E1].pose.distance(BESIDE_SOIL1) < 0.3


@pytest.mark.parametrize("thing", ["obstacle1", "rock1"])
def test_digging_at_something_solid_picks_it_up(crew: MakeCrew, thing: str) -> None:
    """It is in the bucket, not on the ground."""
    yard = crew("E1")
    at = yard.view.objects[thing].position
    yard.stand(E1, at.x, at.y - 5.5, math.pi / 2)
    do(yard, E1, DIG, objects=obj(yard, thing))
    assert yard.machines[E1].load.bodies == (thing,)
    assert next(t for t in yard.world.things if t.name == thing).at is None


def test_a_second_thing_is_picked_up_after_the_first_is_put_down(crew: MakeCrew) -> None:
    """A bucket holds one; what was in it comes to lie at the side."""
    yard = crew("E1")
    yard.stand(E1, -3, 5.5, -math.pi / 2)
    do(yard, E1, DIG, objects=obj(yard, "obstacle1"))
    note = do(yard, E1, DIG, objects=obj(yard, "rock1"), goals=[Pose(x=7, y=3.5, yaw=-math.pi / 2)])
    assert "put down" in (note or "")
    assert yard.machines[E1].load.bodies == ("rock1",)
    lies = next(t for t in yard.world.things if t.name == "obstacle1").at
    assert lies is not None
    assert lies.distance(yard.machines[E1].pose) > 3.0


def test_digging_without_an_object_takes_what_is_in_reach_else_the_ground(crew: MakeCrew) -> None:
    """Beside a pile it digs the pile; in the open it digs the ground in front."""
    yard = at_the_pile(crew, "E1")
    do(yard, E1, DIG)
    assert yard.world.heaps[0].soil_m3 == pytest.approx(11.5)
    field = crew("E1")
    field.stand(E1, -25, -20)
    do(field, E1, DIG)
    assert field.machines[E1].load.soil_m3 == pytest.approx(0.5)
    assert sum(h.soil_m3 for h in field.world.heaps) == pytest.approx(24.0)


def test_digging_where_nothing_is_fails(crew: MakeCrew) -> None:
    """An obstacle that has gone since it was seen cannot be picked up, and no success is made up."""
    yard = crew("E1")
    yard.stand(E1, -3, 5.5, -math.pi / 2)
    for thing in yard.world.things:
        thing.at = None
    reason = failure(yard, E1, DIG, objects=obj(yard, "obstacle1"))
    assert "nothing to pick up at obstacle1" in reason


def test_a_full_bucket_is_not_filled_again(crew: MakeCrew) -> None:
    """Digging with a full bucket succeeds at once and says why."""
    yard = at_the_pile(crew, "E1")
    do(yard, E1, DIG, objects=obj(yard, "soil1"))
    assert "full already" in (do(yard, E1, DIG, objects=obj(yard, "soil1")) or "")
    assert yard.world.heaps[0].soil_m3 == pytest.approx(11.5)


@pytest.mark.parametrize("first", [DUMP, LOAD])
def test_the_load_goes_from_bucket_to_bed_in_either_order(crew: MakeCrew, first: str) -> None:
    """Unloading and loading run beside each other; whichever begins, both end with the soil in the bed."""
    yard = at_the_pile(crew, "E1", "T1")
    do(yard, E1, DIG, objects=obj(yard, "soil1"))
    if first == DUMP:
        do(yard, E1, DUMP, objects=obj(yard, "soil1"), partner=T1)
        do(yard, T1, LOAD, objects=obj(yard, "soil1"), partner=E1)
    else:
        yard.start(T1, LOAD, objects=obj(yard, "soil1"), partner=E1)
        yard.wait(5)
        assert T1 in yard.runs
        do(yard, E1, DUMP, objects=obj(yard, "soil1"), partner=T1)
        assert yard.run()[T1].state is SkillStatusKind.SUCCEEDED
    assert yard.machines[T1].load.soil_m3 == pytest.approx(0.5)
    assert yard.machines[E1].load.empty


def test_a_truck_that_nobody_loads_is_ready_at_once(crew: MakeCrew) -> None:
    """Without a partner there is nothing to wait for."""
    yard = at_the_pile(crew, "E1", "T1")
    assert do(yard, T1, LOAD, objects=obj(yard, "soil1")) == "ready to be loaded"


def test_unloading_waits_for_its_truck(crew: MakeCrew) -> None:
    """The bucket stays closed until the truck stands in reach."""
    yard = at_the_pile(crew, "E1", "T1")
    yard.stand(T1, -28, -4)
    do(yard, E1, DIG, objects=obj(yard, "soil1"))
    yard.start(E1, DUMP, partner=T1)
    yard.wait(20)
    assert yard.machines[E1].load.soil_m3 == pytest.approx(0.5)
    yard.start(T1, "target_area_for_specific_robots", goals=[TRUCK_BESIDE_SOIL1])
    yard.run()
    assert yard.outcomes[E1].state is SkillStatusKind.SUCCEEDED
    assert yard.machines[T1].load.soil_m3 == pytest.approx(0.5)


def test_a_truck_out_of_the_buckets_reach_comes_nearer(crew: MakeCrew) -> None:
    """On the other side of the pile it would wait for ever, so it takes the place that it was given."""
    yard = at_the_pile(crew, "E1", "T1")
    yard.stand(T1, -10, 17, math.pi / 2)
    do(yard, E1, DIG, objects=obj(yard, "soil1"))
    yard.start(T1, LOAD, objects=obj(yard, "soil1"), partner=E1, goals=[TRUCK_BESIDE_SOIL1])
    yard.start(E1, DUMP, objects=obj(yard, "soil1"), partner=T1)
    yard.run()
    assert {o.state for o in yard.outcomes.values()} == {SkillStatusKind.SUCCEEDED}
    assert yard.machines[T1].load.soil_m3 == pytest.approx(0.5)


def test_unloading_into_a_truck_that_never_comes_fails_and_keeps_the_load(crew: MakeCrew) -> None:
    """The wait is bounded, the reason names the truck, and nothing is spilt."""
    yard = at_the_pile(crew, "E1", "T1")
    yard.stand(T1, -28, -4)
    do(yard, E1, DIG, objects=obj(yard, "soil1"))
    reason = failure(yard, E1, DUMP, partner=T1)
    assert T1 in reason
    assert "out of reach" in reason
    assert yard.machines[E1].load.soil_m3 == pytest.approx(0.5)


def test_unloading_without_a_partner_takes_the_nearest_truck_with_room(crew: MakeCrew) -> None:
    """A full bed is passed over; then the soil goes onto the ground at the side."""
    yard = at_the_pile(crew, "E1", "T1")
    do(yard, E1, DIG)
    do(yard, E1, DUMP)
    assert yard.machines[T1].load.soil_m3 == pytest.approx(0.5)
    yard.world.robots[T1].soil_m3 = 1.5
    do(yard, E1, DIG)
    assert "onto the ground" in (do(yard, E1, DUMP) or "")
    assert yard.machines[T1].load.soil_m3 == pytest.approx(1.5)
    assert yard.machines[E1].load.empty
    spilt = yard.world.heaps[-1]
    assert spilt.soil_m3 == pytest.approx(0.5)
    assert spilt.at.distance(bed_centre(yard.machines[T1].pose)) > 2.0


def test_an_empty_bucket_and_an_empty_bed_say_so(crew: MakeCrew) -> None:
    """Nothing to empty is no failure."""
    yard = at_the_pile(crew, "E1", "T1")
    assert "empty already" in (do(yard, E1, DUMP) or "")
    assert "empty already" in (do(yard, T1, TIP) or "")


def test_tipping_brings_the_load_to_a_puddle(crew: MakeCrew) -> None:
    """Rear first, the load lands in the puddle, the bed comes down and the truck pulls out."""
    yard = crew("T1")
    yard.world.robots[T1].soil_m3 = 1.0
    do(yard, T1, TIP, objects=obj(yard, "puddle1"), goals=[Pose(x=-9, y=-6.5, yaw=math.pi / 2)])
    heap = yard.world.heaps[-1]
    assert heap.soil_m3 == pytest.approx(1.0)
    assert heap.at.distance(yard.view.objects["puddle1"].position) < 0.5
    assert yard.machines[T1].telemetry.joints["bed"] < 0.05
    assert yard.machines[T1].pose.distance(heap.at) > 4.0


def test_tipping_at_a_pile_puts_the_load_on_its_edge_without_driving_onto_it(crew: MakeCrew) -> None:
    """The hull stays off the pile, the load lands on it."""
    yard = crew("T1")
    pile = yard.view.objects["soil1"]
    yard.stand(T1, pile.position.x, pile.position.y - 7, math.pi)
    yard.world.robots[T1].soil_m3 = 1.0
    do(yard, T1, TIP, objects=obj(yard, "soil1"))
    assert yard.world.heaps[-1].at.distance(pile.position) < pile.radius_m
    assert min(p.distance(pile.position) for p in yard.tracks[T1]) > pile.radius_m + 1.8


def test_tipping_without_an_object_empties_on_the_spot(crew: MakeCrew) -> None:
    """No object, no driving."""
    yard = crew("T1")
    yard.world.robots[T1].soil_m3 = 1.0
    home = yard.machines[T1].pose
    do(yard, T1, TIP)
    assert yard.machines[T1].load.empty
    assert yard.machines[T1].pose.distance(home) < 0.1


def test_several_objects_are_visited_in_turn(crew: MakeCrew) -> None:
    """The drive passes the first slot before it ends at the second."""
    yard = crew("T1")
    first, second = Pose(x=-9, y=-6.5, yaw=1.5), Pose(x=12, y=-11, yaw=math.pi)
    do(
        yard,
        T1,
        "target_area_for_specific_robots",
        objects=[*obj(yard, "puddle1"), *obj(yard, "puddle2")],
        goals=[first, second],
    )
    assert min(p.distance(first) for p in yard.tracks[T1]) < 0.3
    assert yard.machines[T1].pose.distance(second) < 0.3


def test_return_to_start_ends_at_home(crew: MakeCrew) -> None:
    """Position and heading of the card's home."""
    yard = crew("T1")
    yard.stand(T1, 10, 10, 2.0)
    do(yard, T1, "return_to_start_for_specific_robots")
    home = yard.machines[T1].card.home
    assert yard.machines[T1].pose.distance(home) < 0.3
    assert abs(wrap(yard.machines[T1].pose.yaw - home.yaw)) < 0.15


def test_rules_are_obeyed_once_their_revision_has_come(crew: MakeCrew) -> None:
    """The skill waits for the revision that it was sent for, and fails if that never comes."""
    yard = crew("T1")
    yard.start(T1, "avoid_areas_for_all_robots", objects=obj(yard, "puddle1"), rules_revision=2)
    yard.wait(3)
    assert T1 in yard.runs
    yard.obey(AreaRules(revision=2))
    assert yard.run()[T1].state is SkillStatusKind.SUCCEEDED
    reason = failure(yard, T1, "allow_areas_for_specific_robots", objects=obj(yard, "puddle1"), rules_revision=3)
    assert "revision 3" in reason


def test_who_stands_in_an_area_that_is_closed_drives_out(crew: MakeCrew) -> None:
    """Keeping out begins with getting out."""
    yard = crew("T1")
    rule = AreaRule(robot_id=T1, object_name="puddle1", centre=Point(x=-9, y=-12), radius_m=3.2)
    yard.stand(T1, -9.5, -12.5)
    yard.obey(AreaRules(revision=1, rules=(rule,)))
    do(yard, T1, "avoid_areas_for_specific_robots", objects=obj(yard, "puddle1"), rules_revision=1)
    assert yard.machines[T1].pose.distance(rule.centre) > 3.2 + 1.1


def test_driving_to_what_must_be_avoided_fails_and_names_the_rule(crew: MakeCrew) -> None:
    """Nobody is sent into an area by mistake."""
    yard = crew("T1")
    rule = AreaRule(robot_id=T1, object_name="puddle1", centre=Point(x=-9, y=-12), radius_m=3.2)
    yard.obey(AreaRules(revision=5, rules=(rule,)))
    goals = [Pose(x=-9, y=-6.5)]
    reason = failure(yard, T1, "target_area_for_specific_robots", objects=obj(yard, "puddle1"), goals=goals)
    assert "must avoid puddle1" in reason
    assert "revision 5" in reason


def test_a_skill_that_takes_too_long_fails_standing_still(crew: MakeCrew) -> None:
    """The timeout is site time, and it ends in a halt."""
    yard = crew("T1")
    goals = [Pose(x=20, y=-15)]
    reason = failure(yard, T1, "target_area_for_specific_robots", goals=goals, timeout_s=6)
    assert "6 s" in reason
    assert yard.machines[T1].still


def test_a_cancelled_drive_halts_at_once(crew: MakeCrew) -> None:
    """It is reported when the machine stands, and no path is published any more."""
    yard = crew("T1")
    run = yard.start(T1, "target_area_for_specific_robots", goals=[Pose(x=20, y=-15)])
    yard.wait(6)
    at = yard.machines[T1].pose
    run.cancel()
    assert yard.run()[T1].state is SkillStatusKind.CANCELLED
    assert yard.machines[T1].still
    assert yard.machines[T1].path == ()
    assert yard.machines[T1].pose.distance(at) < 3.0


def test_a_cancelled_digging_keeps_the_bucket_closed(crew: MakeCrew) -> None:
    """What is in the bucket when the cancel comes is still in it after the halt."""
    yard = at_the_pile(crew, "E1")
    run = yard.start(E1, DIG, objects=obj(yard, "soil1"))
    while yard.machines[E1].load.empty:
        yard.step()
    run.cancel()
    assert yard.run()[E1].state is SkillStatusKind.CANCELLED
    yard.wait(3)
    assert yard.machines[E1].load.soil_m3 == pytest.approx(0.5)


def test_a_cancelled_tipping_lowers_the_bed(crew: MakeCrew) -> None:
    """No machine is left with its bed up."""
    yard = crew("T1")
    yard.world.robots[T1].soil_m3 = 1.0
    run = yard.start(T1, TIP)
    while yard.world.robots[T1].joints["bed"] < 0.3:
        yard.step()
    run.cancel()
    assert yard.run()[T1].state is SkillStatusKind.CANCELLED
    assert yard.world.robots[T1].joints["bed"] < 0.05
    assert yard.machines[T1].load.soil_m3 == pytest.approx(1.0)


def test_a_paused_skill_holds_still_and_goes_on(crew: MakeCrew) -> None:
    """However long the pause, no timeout runs out in it."""
    yard = crew("T1")
    run = yard.start(T1, "target_area_for_specific_robots", goals=[Pose(x=10, y=-15)], timeout_s=60)
    yard.wait(6)
    run.pause()
    yard.wait(4)
    assert run.held
    at = yard.machines[T1].pose
    yard.wait(200)
    assert yard.machines[T1].pose.distance(at) < 0.01
    run.resume()
    assert yard.run()[T1].state is SkillStatusKind.SUCCEEDED


def test_a_paused_bucket_stays_where_it_is(crew: MakeCrew) -> None:
    """Joints hold still as well, and the digging ends well after it."""
    yard = at_the_pile(crew, "E1")
    run = yard.start(E1, DIG, objects=obj(yard, "soil1"))
    yard.wait(2)
    run.pause()
    yard.wait(1)
    joints = yard.machines[E1].telemetry.joints
    yard.wait(30)
    assert yard.machines[E1].telemetry.joints == joints
    run.resume()
    assert yard.run()[E1].state is SkillStatusKind.SUCCEEDED
    assert yard.machines[E1].load.soil_m3 == pytest.approx(0.5)
