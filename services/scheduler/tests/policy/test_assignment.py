"""The order of tasks over all robots, and whom selectors mean, looked at together."""

import math

import pytest
from muster_scheduler.policy.durations import Durations
from muster_scheduler.policy.problem import Choice, Job, Problem
from muster_scheduler.policy.search import Limits, greedy, solve
from muster_scheduler.testing import Yard, planned
from muster_schemas.base import Pose
from muster_schemas.robot import SkillStatusKind

E1, E2, E3 = "robot_excavator_01", "robot_excavator_02", "robot_excavator_03"
T1, T2, T3 = "robot_dump_truck_01", "robot_dump_truck_02", "robot_dump_truck_03"
GO, DIG, TIP = "target_area_for_specific_robots", "Excavation", "DumpUnloading"


def a_problem() -> Problem:
    """Return one whose greedy answer is bad: who is nearest to the first job is the only one for the last."""
    far, near = [[0.0, 50.0], [50.0, 0.0]], [[0.0, 5.0], [5.0, 0.0]]
    jobs = (
        Job(("m", "a"), choice=0, stops=(1,), work_s=20.0),
        Job(("m", "b"), robots=(0,), work_s=60.0),
        Job(("m", "c"), after=(1,), robots=(1,), work_s=10.0),
    )
    return Problem(("r0", "r1"), (0.0, 0.0), (0, 0), (0, 0), (near, far), jobs, (Choice(("m", "1 x"), ((0, 1),)),))


def test_the_search_is_never_worse_than_list_scheduling_and_repeats_itself() -> None:
    """The same seed and number of steps give the same answer; no time at all gives the greedy one."""
    problem = a_problem()
    one, other = (solve(problem, Limits(seconds=math.inf, steps=200), seed=4) for _ in range(2))
    assert (one.order, one.teams) == (other.order, other.teams)
    assert one.makespan_s <= greedy(problem).makespan_s
    assert solve(problem, Limits(seconds=0.0)).makespan_s == greedy(problem).makespan_s


def test_an_answer_keeps_order_and_lets_no_robot_do_two_things_at_once() -> None:
    """Times follow from the order: after what comes before, one job at a time for each robot."""
    problem = a_problem()
    answer = solve(problem, Limits(seconds=math.inf, steps=200))
    for number, job in enumerate(problem.jobs):
        assert all(answer.ends_s[a] <= answer.starts_s[number] for a in job.after)
        for other in range(number):
            team = [{*j.robots, *(answer.teams[j.choice] if j.choice is not None else ())} for j in problem.jobs]
            apart = answer.ends_s[other] <= answer.starts_s[number] or answer.ends_s[number] <= answer.starts_s[other]
            assert apart or not team[number] & team[other]


def test_a_chain_of_named_robots_needs_no_search(yard: Yard) -> None:
    """The common case, one ready task and a named robot, goes out without anybody looking for better."""
    names = [f"n{i}" for i in range(60)]
    mission = yard.submit(*(planned(n, DIG, [(E1, E2)[i % 2]], names[max(i - 1, 0) : i]) for i, n in enumerate(names)))
    yard.run(mission)
    assert yard.ended_well(mission)
    assert yard.assignment.searches == 0


def test_a_selector_leaves_a_robot_to_the_task_that_names_it(yard: Yard) -> None:
    """The nearest truck is about to be wanted by name elsewhere, so another is taken at once."""
    yard.world.poses[T1] = Pose(x=10, y=13, yaw=0)
    yard.world.poses[T2] = Pose(x=8, y=10, yaw=0)
    busy = yard.submit(planned("dig", DIG, [E1]), planned("tip", TIP, [T1], after=["dig"]))
    yard.say(E1, busy.tasks["t1"], SkillStatusKind.STARTED)
    chain = [
        planned(f"n{i}", TIP, (), [f"n{i - 1}"] if i else [], types=["dump_truck"], count=1, objects=["soil2"])
        for i in range(4)
    ]
    assert yard.submit(*chain).tasks["t1"].robots == (T2,)


def test_a_robot_is_kept_for_what_makes_everything_end_sooner(yard: Yard) -> None:
    """A long chain hangs on a robot that is wanted in a moment; a side task waits, says so, and is not forgotten."""
    yard.world.poses[E1] = yard.world.poses[E2] = Pose(x=-15, y=12, yaw=0)
    names = [f"n{i}" for i in range(6)]
    chain = yard.submit(
        planned("first", DIG, [E2], objects=["soil1"]),
        *(planned(n, DIG, [E1], [names[i - 1] if i else "first"], objects=["soil1"]) for i, n in enumerate(names)),
    )
    first = chain.tasks["t1"]
    yard.say(E2, first, SkillStatusKind.STARTED)
    yard.now += 18.0
    side = yard.submit(planned("side", GO, [E1], objects=["puddle2"]))
    assert not side.tasks["t1"].active
    assert side.tasks["t1"].waiting_for == (f"robot: {E1} (kept for {chain.mission_id}/t2)",)
    # what it was kept for does not come: then the side task goes
    yard.wait(200)
    assert side.tasks["t1"].active


@pytest.mark.parametrize("gone", ["lost", "stopped"])
def test_a_robot_that_leaves_is_replaced_where_nobody_is_bound_to_it(yard: Yard, gone: str) -> None:
    """The selector that was to mean it means another one, which is free."""
    for truck in (T2, T3):
        yard.submit(planned("tip", TIP, [truck]))
    busy = yard.submit(planned("go", GO, [T1], objects=["puddle1"]))
    yard.all_say(busy.tasks["t1"], SkillStatusKind.STARTED)
    mission = yard.submit(planned("go", GO, types=["dump_truck"], count=1, objects=["soil2"]))
    assert not mission.tasks["t1"].active
    for truck in (T2, T3):
        if gone == "lost":
            yard.robot_lost(truck)
        else:
            yard.stop(truck)
    yard.finish(busy.tasks["t1"])
    yard.wait(31)
    assert mission.tasks["t1"].robots == (T1,)


def test_a_robot_that_joins_gets_work_at_once(yard: Yard) -> None:
    """An open selector that waited for one of the fleet takes the newcomer."""
    for truck in (T1, T2, T3):
        yard.robot_lost(truck)
    mission = yard.submit(planned("go", GO, types=["dump_truck"], count=1, objects=["soil2"]))
    assert mission.tasks["t1"].waiting_for == ("robot: 1 dump_truck",)
    yard.robot_comes(T3)
    assert mission.tasks["t1"].active


def test_durations_learn_from_what_tasks_took() -> None:
    """A site that runs ten times faster is soon known to."""
    durations = Durations()
    for _ in range(30):
        durations.learn("dig", "excavator", 20.0 * durations.pace.get(("dig", "excavator"), 1.0), 2.0)
    assert durations.pace["dig", "excavator"] == pytest.approx(0.1, rel=0.05)
