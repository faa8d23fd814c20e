"""Who gets which robot, and when."""

import itertools

from muster_scheduler.testing import Yard, planned
from muster_schemas.base import Pose
from muster_schemas.mission import MissionStatus, TaskStatus
from muster_schemas.robot import SkillStatusKind
from muster_schemas.rpc import MissionAction

E1, E2, E3 = "robot_excavator_01", "robot_excavator_02", "robot_excavator_03"
T1, T2, T3 = "robot_dump_truck_01", "robot_dump_truck_02", "robot_dump_truck_03"
GO, DIG, AVOID, ALLOW, HOME = (
    "target_area_for_specific_robots",
    "Excavation",
    "avoid_areas_for_specific_robots",
    "allow_areas_for_specific_robots",
    "return_to_start_for_all_robots",
)


def test_a_robot_does_one_task_at_a_time_across_missions(yard: Yard) -> None:
    """The second mission waits for it by name and starts when it is given back."""
    first, second = yard.submit(planned("dig", DIG, [E1])), yard.submit(planned("dig", DIG, [E1]))
    assert second.tasks["t1"].waiting_for == (f"robot: {E1}",)
    yard.finish(first.tasks["t1"])
    assert second.tasks["t1"].state is TaskStatus.DISPATCHED


def test_a_more_urgent_mission_goes_first(yard: Yard) -> None:
    """Among those that wait for a robot the priority decides, then the age."""
    first = yard.submit(planned("dig", DIG, [E1]))
    late, urgent = (yard.submit(planned("dig", DIG, [E1]), priority=p) for p in (5, 9))
    yard.finish(first.tasks["t1"])
    assert urgent.tasks["t1"].active
    assert not late.tasks["t1"].active


def test_a_team_reserves_all_or_none(yard: Yard) -> None:
    """While one of its robots is busy it holds none, so two teams can never wait for each other."""
    busy = yard.submit(planned("dig", DIG, [E2]))
    team = yard.submit(planned("go", GO, [E1, E2], objects=["soil1"]))
    assert team.tasks["t1"].waiting_for == (f"robot: {E2}",)
    other = yard.submit(planned("dig", DIG, [E1]))
    assert other.tasks["t1"].active
    assert team.tasks["t1"].waiting_for == (f"robot: {E1}", f"robot: {E2}")
    yard.finish(busy.tasks["t1"])
    yard.finish(other.tasks["t1"])
    assert team.tasks["t1"].active


def test_a_team_that_has_waited_long_is_not_overtaken_for_ever(yard: Yard) -> None:
    """After half a step of ageing its robots are kept for it as they come free."""
    digs = [yard.submit(planned("dig", DIG, [e])) for e in (E1, E2)]
    team = yard.submit(planned("go", GO, [E1, E2], objects=["soil1"]))
    yard.wait(151)
    late = yard.submit(planned("dig", DIG, [E1]))
    yard.finish(digs[0].tasks["t1"])
    assert not late.tasks["t1"].active
    yard.finish(digs[1].tasks["t1"])
    assert team.tasks["t1"].active


def test_two_trucks_stay_the_same_two(yard: Yard) -> None:
    """A selector binds once per mission; equal selectors mean the same robots, the nearest ones."""
    yard.world.poses[T3] = Pose(x=10, y=13, yaw=0)
    mission = yard.submit(
        planned("go", GO, types=["dump_truck"], count=1, objects=["soil2"]),
        planned("on", GO, types=["dump_truck"], count=1, objects=["soil1"], after=["go"]),
    )
    assert mission.tasks["t1"].robots == (T3,)
    yard.run(mission)
    assert mission.tasks["t2"].robots == (T3,)


def test_robots_that_the_plan_names_elsewhere_come_last(yard: Yard) -> None:
    """'Truck 1 goes there, one truck comes here' means another truck, even a farther one."""
    yard.world.poses[T1] = Pose(x=10, y=13, yaw=0)
    mission = yard.submit(
        planned("named", GO, [T1], objects=["puddle1"]),
        planned("any", GO, types=["dump_truck"], count=1, objects=["soil2"]),
    )
    assert mission.tasks["t2"].robots != (T1,)


def test_all_of_a_type_and_the_whole_fleet(yard: Yard) -> None:
    """'All excavators' and the fleet-wide skills take everyone who is there."""
    yard.robot_lost(T3)
    mission = yard.submit(
        planned("dig", DIG, types=["excavator"], count="all"), planned("home", HOME, after=["dig"])
    )  # fmt: skip
    assert mission.tasks["t1"].robots == (E1, E2, E3)
    yard.run(mission)
    assert mission.tasks["t2"].robots == (T1, T2, E1, E2, E3)
    assert yard.ended_well(mission)


def test_selectors_of_several_missions_get_distinct_robots(yard: Yard) -> None:
    """The matching is over all that is open; who finds no robot waits, and says for what."""
    missions = [yard.submit(planned("go", GO, types=["dump_truck"], count=2, objects=["soil1"])) for _ in range(2)]
    assert missions[0].tasks["t1"].active
    assert missions[1].tasks["t1"].waiting_for == ("robot: 2 dump_truck",)
    yard.run(missions[0])
    yard.run(missions[1])
    assert all(yard.ended_well(m) for m in missions)


def test_a_lost_robot_is_not_chosen_and_a_named_one_is_waited_for(yard: Yard) -> None:
    """Lost means that nothing is dispatched to it."""
    yard.robot_lost(T1)
    any_truck = yard.submit(planned("go", GO, types=["dump_truck"], count=1, objects=["puddle1"]))
    named = yard.submit(planned("go", GO, [T1], objects=["puddle1"]))
    assert any_truck.tasks["t1"].robots in ((T2,), (T3,))
    assert named.tasks["t1"].waiting_for == (f"robot: {T1}",)
    yard.robot_back(T1)
    assert named.tasks["t1"].active


def test_a_crew_at_one_object_gets_places_of_its_own(yard: Yard) -> None:
    """Nobody is sent where another stands or is sent."""
    mission = yard.submit(planned("go", GO, [E1, E2, T1, T2], objects=["rock1"]))
    goals = {r.robot_id: r.order.goals[0] for r in mission.tasks["t1"].runs.values()}
    assert len(goals) == 4
    for one, other in itertools.combinations(goals.values(), 2):
        assert one.distance(other) > 4.2


def test_robots_that_set_out_by_tasks_of_their_own_at_one_moment_get_places_beside_each_other(yard: Yard) -> None:
    """Each place is chosen knowing the ones that were given a moment before: apart, and in the excavator's reach."""
    mission = yard.submit(
        planned("excavator", GO, [E1], objects=["soil1"]),
        planned("truck", GO, [T1], objects=["soil1"]),
        planned("dig", DIG, [E1], ["excavator"], objects=["soil1"]),
        planned("load", "ExcavatorUnloading", [E1], ["dig", "truck"], objects=["soil1"]),
    )
    excavator, truck = (mission.tasks[t].runs[r].order.goals[0] for t, r in (("t1", E1), ("t2", T1)))
    cards = yard.core.state.robots
    assert excavator.distance(truck) >= cards[E1].card.radius_m + cards[T1].card.radius_m + 0.5
    assert excavator.distance(truck) <= cards[E1].card.reach_m - 1.0


def test_an_object_that_has_left_the_map_is_waited_for_and_then_given_up(yard: Yard) -> None:
    """Nobody drives to where nothing is; the task says what it waits for, and fails after a minute."""
    first = yard.submit(planned("dig", DIG, [E1]), planned("go", GO, [E1], after=["dig"], objects=["rock1"]))
    second = yard.submit(planned("dig", DIG, [E2]), planned("go", GO, [E2], after=["dig"], objects=["rock1"]))
    yard.lose_sight("rock1")
    yard.finish(first.tasks["t1"])
    yard.finish(second.tasks["t1"])
    assert first.tasks["t2"].waiting_for == ("object: rock1",)
    yard.control(second, MissionAction.CANCEL)
    yard.wait(59)
    assert first.tasks["t2"].state is TaskStatus.READY
    yard.wait(2)
    assert first.state is MissionStatus.FAILED
    assert "rock1" in (first.tasks["t2"].error or "")


def test_an_object_that_comes_back_in_time_is_driven_to(yard: Yard) -> None:
    """The wait ends when the cameras see it again."""
    mission = yard.submit(planned("dig", DIG, [E1]), planned("go", GO, [E1], after=["dig"], objects=["rock1"]))
    yard.lose_sight("rock1")
    yard.finish(mission.tasks["t1"])
    yard.wait(30)
    yard.see(yard.site, ["rock1"])
    assert mission.tasks["t2"].active


def test_where_there_is_no_room_the_task_waits_and_then_fails(yard: Yard) -> None:
    """A place that never comes free is no reason to wait for ever."""
    wall = yard.world.objects["rock1"]
    size = wall.size.model_copy(update={"length_m": 60.0, "width_m": 60.0})
    yard.world.objects["obstacle1"] = yard.world.objects["obstacle1"].model_copy(update={"size": size})
    mission = yard.submit(planned("go", GO, [E1], objects=["rock1"]))
    assert mission.tasks["t1"].waiting_for == (f"room: a place for {E1} at rock1",)
    for _ in range(40):
        yard.wait(2)
    assert mission.state is MissionStatus.FAILED


def test_driving_to_what_must_be_avoided_fails_and_names_the_rule(yard: Yard) -> None:
    """Rules add up, hold for the robots that they name, and are gone when they are lifted."""
    for thing in ("rock1", "puddle1"):
        yard.run(yard.submit(planned("keep out", AVOID, [T1], objects=[thing])))
    forbidden = yard.submit(planned("go", GO, [T1], objects=["rock1"]))
    assert forbidden.state is MissionStatus.FAILED
    assert "rock1" in (forbidden.tasks["t1"].error or "")
    assert yard.submit(planned("go", GO, [T2], objects=["rock1"])).tasks["t1"].active
    yard.run(yard.submit(planned("open", ALLOW, [T1], objects=["rock1"])))
    assert yard.submit(planned("go", GO, [T1], objects=["rock1"])).tasks["t1"].active
    assert [r.object_name for r in yard.core.state.rules.avoided_by(T1)] == ["puddle1"]


def test_a_rule_about_what_has_gone_can_be_lifted(yard: Yard) -> None:
    """As in: the obstacle was taken away, you may enter again."""
    yard.run(yard.submit(planned("keep out", AVOID, [T1], objects=["obstacle2"])))
    yard.lose_sight("obstacle2")
    mission = yard.submit(planned("open", ALLOW, [T1], objects=["obstacle2"]))
    yard.run(mission)
    assert yard.ended_well(mission)
    assert not yard.core.state.rules.rules


def test_area_rules_reach_robots_that_are_at_work(yard: Yard) -> None:
    """'Nobody drives through puddle 2' does not wait until all are idle."""
    working = yard.submit(planned("dig", DIG, [E1]))
    yard.say(E1, working.tasks["t1"], SkillStatusKind.STARTED)
    mission = yard.submit(planned("keep out", AVOID, [E1, T1], objects=["puddle2"]))
    assert mission.tasks["t1"].state is TaskStatus.DISPATCHED


def test_a_robot_visits_several_objects_in_turn(yard: Yard) -> None:
    """One goal for each."""
    mission = yard.submit(planned("tour", GO, [T1], objects=["soil1", "rock1", "puddle2"]))
    (run,) = mission.tasks["t1"].runs.values()
    for goal, target in zip(run.order.goals, mission.tasks["t1"].targets, strict=True):
        assert goal.distance(target.position) < 8


def test_an_excavator_in_reach_of_its_pile_stays_where_it_is(yard: Yard) -> None:
    """Work at an object moves the machine only if it has to."""
    yard.world.poses[E1] = Pose(x=-15, y=12, yaw=0)
    mission = yard.submit(planned("dig", DIG, [E1], objects=["soil1"]))
    (run,) = mission.tasks["t1"].runs.values()
    assert run.order.goals == (Pose(x=-15, y=12, yaw=0),)


def test_a_selector_that_stood_back_for_a_rule_is_looked_at_again(yard: Yard) -> None:
    """A rule takes no robot's time, so no robot is given back afterwards (found by the simulation)."""
    before = yard.submit(planned("busy", GO, [E1, E2, E3], objects=["rock1"]))
    yard.submit(planned("keep out", AVOID, (), objects=["soil1"], types=["excavator"], count=1))
    late = yard.submit(planned("all three", DIG, (), types=["excavator"], count=3))
    yard.finish(before.tasks["t1"])
    assert late.tasks["t1"].state is TaskStatus.DISPATCHED
