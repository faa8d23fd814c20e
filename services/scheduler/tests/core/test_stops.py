"""Stops of one robot and of everything: latched, asked for until obeyed, and answered with what is known."""

import pytest
from muster_scheduler.core import stops
from muster_scheduler.core.errors import NotPossibleError
from muster_scheduler.core.events import Started
from muster_scheduler.testing import Yard, planned, replayed
from muster_schemas.mission import MissionStatus, TaskStatus
from muster_schemas.robot import RequestAction, SkillStatusKind
from muster_schemas.rpc import ErrorCode, MissionAction
from muster_schemas.stops import NO_ANSWER, NOT_REACHABLE

E1, E2, T1 = "robot_excavator_01", "robot_excavator_02", "robot_dump_truck_01"
GO, DIG, AVOID = "target_area_for_specific_robots", "Excavation", "avoid_areas_for_specific_robots"


def test_a_stopped_robots_work_is_held_and_goes_on_after_the_release(yard: Yard) -> None:
    """The task pauses, other robots go on, and nothing is lost."""
    mission = yard.submit(planned("dig", DIG, [E1]), planned("go", GO, [T1], objects=["soil1"]))
    task = mission.tasks["t1"]
    yard.all_say(task, SkillStatusKind.STARTED)
    yard.stop(E1)
    assert {r.action for (robot, _), r in yard.outbox.items() if robot == E1} == {RequestAction.PAUSE}
    assert stops.known(yard.core.state, E1).robots == {E1: NO_ANSWER}
    yard.obey_stop(E1, standing=False)
    assert stops.known(yard.core.state, E1).robots == {E1: NO_ANSWER}
    yard.obey_stop(E1, was_busy=True)
    yard.say(E1, task, SkillStatusKind.PAUSED)
    assert stops.known(yard.core.state, E1).robots == {E1: "stopped"}
    assert task.state is TaskStatus.PAUSED
    assert task.waiting_for == (f"robot: {E1} (stopped)",)
    assert not yard.stops
    yard.stop(E1, stop=False)
    yard.obey_stop(E1)
    assert stops.known(yard.core.state, E1).robots == {E1: "released"}
    assert {r.action for (robot, _), r in yard.outbox.items() if robot == E1} == {RequestAction.RESUME}
    yard.run(mission)
    assert yard.ended_well(mission)


def test_nothing_starts_on_a_stopped_robot(yard: Yard) -> None:
    """Its tasks say that it is stopped; they start at the release."""
    yard.stop(E1)
    mission = yard.submit(planned("dig", DIG, [E1]), planned("keep out", AVOID, [E1], objects=["puddle1"]))
    assert mission.tasks["t1"].waiting_for == (f"robot: {E1} (stopped)",)
    assert yard.tasks(mission, TaskStatus.DISPATCHED) == ["keep out"]
    yard.stop(E1, stop=False)
    assert yard.tasks(mission, TaskStatus.DISPATCHED) == ["dig", "keep out"]


def test_a_stop_of_everything_reaches_all_and_those_who_come_later(yard: Yard) -> None:
    """Idle robots answer, too; what cannot be reached is said to be unknown; robots that come are told at once."""
    yard.robot_lost(T1)
    yard.stop()
    assert set(yard.stops) == set(yard.core.state.robots)
    for robot_id in yard.core.state.robots:
        if robot_id != T1:
            yard.obey_stop(robot_id)
    answer = stops.known(yard.core.state, None)
    assert answer.site_stopped
    assert stops.all_said(yard.core.state, None)
    assert answer.robots.pop(T1) == NOT_REACHABLE
    assert set(answer.robots.values()) == {"was idle"}
    yard.robot_comes(T1)
    assert stops.known(yard.core.state, T1).robots == {T1: NO_ANSWER}
    yard.obey_stop(T1)
    assert stops.known(yard.core.state, T1).robots == {T1: "was idle"}


def test_a_release_of_everything_leaves_stopped_who_was_stopped_alone(yard: Yard) -> None:
    """A robot that someone works at does not drive off because the site goes on."""
    yard.stop(E1)
    yard.stop()
    with pytest.raises(NotPossibleError) as refused:
        yard.stop(E1, stop=False)
    assert refused.value.code is ErrorCode.CONFLICT
    yard.stop(stop=False)
    assert [r for r, robot in yard.core.state.robots.items() if robot.stopped] == [E1]
    with pytest.raises(NotPossibleError) as refused:
        yard.stop("robot_nobody")
    assert refused.value.code is ErrorCode.NOT_FOUND


def test_a_start_that_may_not_have_arrived_does_not_happen_after_a_stop(yard: Yard) -> None:
    """The robot is asked what it knows; what it never saw gets a new attempt after the release."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    task = mission.tasks["t1"]
    yard.stop(E1)
    (request,) = yard.outbox.values()
    assert request.action is RequestAction.QUERY
    yard.say(E1, task, SkillStatusKind.UNKNOWN)
    yard.wait(5)
    assert task.state is TaskStatus.READY
    yard.stop(E1, stop=False)
    assert (task.state, task.attempt) == (TaskStatus.DISPATCHED, 2)


def test_a_mission_can_be_cancelled_while_its_robots_are_stopped(yard: Yard) -> None:
    """The stop holds on after it."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.STARTED)
    yard.stop()
    yard.control(mission, MissionAction.CANCEL)
    assert {r.action for r in yard.outbox.values()} == {RequestAction.CANCEL}
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.CANCELLED)
    assert mission.state is MissionStatus.CANCELLED
    assert yard.core.state.robots[E1].stopped


def test_a_scheduler_killed_in_the_middle_of_a_stop_goes_on_with_it(yard: Yard) -> None:
    """After a replay the orders that nobody has answered go out again, and the answered ones do not."""
    yard.stop()
    yard.obey_stop(E1)
    core = replayed(yard.events)
    assert core.state == yard.core.state
    yard.core = core
    yard.stops.clear()
    yard.happen(Started(at=yard.now, epoch=2))
    assert set(yard.stops) == set(yard.core.state.robots) - {E1}
    yard.robot_back(E2)
    assert yard.stops[E2].stopped


def test_an_agent_with_a_new_life_is_asked_whether_it_stands(yard: Yard) -> None:
    """What its former life said does not count for this one; of a release it does."""
    yard.stop(E1)
    yard.obey_stop(E1)
    yard.robot_comes(E1)
    assert yard.stops[E1].stopped
    yard.obey_stop(E1)
    yard.stop(E1, stop=False)
    yard.obey_stop(E1)
    yard.robot_comes(E1)
    assert not yard.stops


def test_a_stop_twice_is_a_stop_once_and_late_words_count_for_nothing(yard: Yard) -> None:
    """The number of the order does not change; the word on an older order is no news."""
    yard.stop(E1)
    first = yard.stops[E1]
    yard.stop(E1)
    assert yard.stops[E1] == first
    yard.stop(E1, stop=False)
    yard.stops[E1], newest = first, yard.stops[E1]
    yard.obey_stop(E1)
    yard.stops[E1] = newest
    assert newest.number > first.number
    assert stops.known(yard.core.state, E1).robots == {E1: NO_ANSWER}
