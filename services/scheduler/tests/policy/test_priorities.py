"""Many missions, one fleet: who goes first, who is put off, and for how long at most."""

import pytest
from muster_scheduler.core.state import Mission
from muster_scheduler.testing import Yard, planned
from muster_schemas.rpc import MissionAction

E1, E2 = "robot_excavator_01", "robot_excavator_02"
DIG = "Excavation"
STEP_S = 300.0
"""What one step of priority is worth."""


def dig(yard: Yard, priority: int, robots: tuple[str, ...] = (E1,)) -> Mission:
    """Submit a mission of one digging."""
    return yard.submit(planned("dig", DIG, robots), priority=priority)


def began(mission: Mission) -> bool:
    """Return whether a mission's first task has been given to its robots."""
    return mission.tasks["t1"].attempt > 0


@pytest.mark.parametrize("priority", range(9))
def test_each_step_of_priority_counts(yard: Yard, priority: int) -> None:
    """Of two that came at the same time the higher one goes first."""
    busy = dig(yard, 5)
    low, high = dig(yard, priority), dig(yard, priority + 1)
    yard.finish(busy.tasks["t1"])
    assert (began(high), began(low)) == (True, False)


def test_waiting_makes_up_for_priority(yard: Yard) -> None:
    """A mission that has waited a step longer is as urgent as one of the next priority that comes then."""
    busy, low = dig(yard, 5), dig(yard, 4)
    yard.wait(STEP_S + 1)
    high = dig(yard, 5)
    yard.finish(busy.tasks["t1"])
    assert (began(low), began(high)) == (True, False)


def test_the_lowest_mission_has_its_turn_while_highest_ones_keep_coming(yard: Yard) -> None:
    """Whoever comes more than nine steps later is behind it, however high: that bounds how long it waits."""
    now = dig(yard, 9)
    low = dig(yard, 0)
    overtaken = 0
    while not began(low):
        urgent = dig(yard, 9)
        yard.now += 100.0
        yard.finish(now.tasks["t1"])
        now = urgent
        overtaken += 1
        assert overtaken * 100.0 <= 9 * STEP_S + 200.0
    assert overtaken * 100.0 > 8 * STEP_S


def test_missions_of_one_priority_share_a_robot_in_turn(yard: Yard) -> None:
    """Four missions that each want it five times: none has had it all before another has had it at all."""
    names = [f"n{i}" for i in range(5)]
    missions = [
        yard.submit(*(planned(n, DIG, [E1], names[max(i - 1, 0) : i]) for i, n in enumerate(names))) for _ in range(4)
    ]
    turns = 0
    while not all(yard.ended_well(m) for m in missions):
        (task,) = [m.tasks[t] for m in missions for t in m.active]
        yard.now += 20.0
        yard.finish(task)
        turns += 1
    assert turns == 20
    longest = max((m.ended_at or 0.0) for m in missions) - min(m.created_at for m in missions)
    assert longest <= 20 * 20.0 + 1


def test_an_urgent_mission_takes_the_robot_between_two_tasks(yard: Yard) -> None:
    """What is under way is not cut off; the lower mission keeps its robot by name and goes on with it afterwards."""
    low = yard.submit(planned("one", DIG, [E1]), planned("two", DIG, [E1], after=["one"]), priority=2)
    urgent = dig(yard, 9)
    assert not began(urgent)
    yard.finish(low.tasks["t1"])
    assert began(urgent)
    assert low.tasks["t2"].waiting_for == (f"robot: {E1}",)
    yard.finish(urgent.tasks["t1"])
    yard.finish(low.tasks["t2"])
    assert yard.ended_well(low)


def test_a_selector_stays_bound_when_its_robot_is_taken_for_a_while(yard: Yard) -> None:
    """One binding for each mission and selector: the chain goes on with the same machine, though others are free."""
    low = yard.submit(
        planned("one", DIG, types=["excavator"], count=1),
        planned("two", DIG, after=["one"], types=["excavator"], count=1),
        priority=2,
    )
    (mine,) = low.tasks["t1"].robots
    urgent = dig(yard, 9, (mine,))
    yard.finish(low.tasks["t1"])
    assert began(urgent)
    assert low.tasks["t2"].robots == (mine,)
    yard.finish(urgent.tasks["t1"])
    assert low.tasks["t2"].active


def test_a_mission_ages_from_when_it_may_run(yard: Yard) -> None:
    """Hours of waiting for a person's approval make it no more urgent than others."""
    busy = dig(yard, 5)
    asked = yard.submit(planned("dig", DIG, [E1]), ask=True)
    yard.wait(10_000)
    other = dig(yard, 5)
    yard.wait(200)
    yard.control(asked, MissionAction.APPROVE)
    yard.finish(busy.tasks["t1"])
    assert (began(other), began(asked)) == (True, False)
