"""Team tasks: reserved as one, started as one, ended as one; and never in each other's way for ever."""

import itertools
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from muster_scheduler.testing import Yard, planned, yard_file
from muster_schemas.mission import MissionStatus, TaskStatus
from muster_schemas.plan import PlanTask
from muster_schemas.robot import RequestAction, SkillStatusKind
from muster_schemas.site import load_site

SITE = load_site(yard_file())
E1, E2, E3 = "robot_excavator_01", "robot_excavator_02", "robot_excavator_03"
T1 = "robot_dump_truck_01"
ROBOTS = [r.id for r in SITE.robots]
GO, DIG, HOME = "target_area_for_specific_robots", "Excavation", "return_to_start_for_specific_robots"
PREPARE, START, CANCEL = RequestAction.PREPARE, RequestAction.START, RequestAction.CANCEL


def asked(yard: Yard) -> dict[str, RequestAction]:
    """Return what each robot is being asked."""
    return {r.robot_id: r.action for r in yard.outbox.values()}


def test_nobody_of_a_team_starts_before_all_have_accepted(yard: Yard) -> None:
    """All are asked to prepare; the start goes out to all of them when the last has accepted."""
    task = yard.submit(planned("dig", DIG, [E1, E2])).tasks["t1"]
    assert asked(yard) == {E1: PREPARE, E2: PREPARE}
    yard.say(E1, task, SkillStatusKind.ACCEPTED)
    assert asked(yard) == {E2: PREPARE}
    yard.say(E2, task, SkillStatusKind.ACCEPTED)
    assert asked(yard) == {E1: START, E2: START}
    yard.all_say(task, SkillStatusKind.STARTED)
    assert asked(yard) == {}
    assert task.state is TaskStatus.RUNNING


def test_a_robot_alone_starts_at_once(yard: Yard) -> None:
    """There is nobody to wait for."""
    yard.submit(planned("dig", DIG, [E1]))
    assert asked(yard) == {E1: START}


def test_a_team_of_which_one_refuses_has_not_moved(yard: Yard) -> None:
    """The others give up their reservation, and even a digging is tried again."""
    task = yard.submit(planned("dig", DIG, [E1, E2])).tasks["t1"]
    yard.say(E1, task, SkillStatusKind.ACCEPTED)
    yard.say(E2, task, SkillStatusKind.REFUSED, reason="busy")
    assert asked(yard) == {E1: CANCEL}
    yard.say(E1, task, SkillStatusKind.CANCELLED)
    assert task.state is TaskStatus.READY
    yard.wait(1.5)
    assert asked(yard) == {E1: PREPARE, E2: PREPARE}
    assert task.attempt == 2


def test_a_team_of_which_one_is_lost_at_work_halts(yard: Yard) -> None:
    """The others are stopped; the task fails and says who was lost, and what that one did is unknown."""
    mission = yard.submit(planned("dig", DIG, [E1, E2]))
    task = mission.tasks["t1"]
    yard.all_say(task, SkillStatusKind.STARTED)
    yard.robot_lost(E2)
    assert asked(yard)[E1] is CANCEL
    yard.say(E1, task, SkillStatusKind.CANCELLED)
    assert mission.state is MissionStatus.FAILED
    assert f"{E2}: lost" in (task.error or "")


def test_a_team_of_which_one_is_lost_before_the_start_is_tried_again(yard: Yard) -> None:
    """Nothing has moved, so nothing is unknown: the task waits until all are there."""
    task = yard.submit(planned("dig", DIG, [E1, E2])).tasks["t1"]
    yard.say(E1, task, SkillStatusKind.ACCEPTED)
    yard.robot_lost(E2)
    yard.say(E1, task, SkillStatusKind.CANCELLED)
    assert task.state is TaskStatus.READY
    yard.wait(1.5)
    yard.robot_comes(E2)
    yard.say(E2, task, SkillStatusKind.UNKNOWN, attempt=1)
    assert asked(yard) == {E1: PREPARE, E2: PREPARE}


def test_a_paused_team_does_not_start(yard: Yard) -> None:
    """The common start waits for the mission to go on."""
    mission = yard.submit(planned("dig", DIG, [E1, E2]))
    task = mission.tasks["t1"]
    yard.say(E1, task, SkillStatusKind.ACCEPTED)
    yard.stop(E1)
    yard.say(E2, task, SkillStatusKind.ACCEPTED)
    assert asked(yard).get(E1) is not START


def go(name: str, team: Sequence[str], after: Sequence[str] = ()) -> PlanTask:
    """Return a drive of a team."""
    return planned(name, GO, team, after, objects=["soil1"])


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_missions_that_want_the_same_teams_in_another_order_all_end(order: tuple[int, ...]) -> None:
    """Two or three missions each take a ring of overlapping teams, each beginning at another place."""
    for count in (2, 3):
        yard = Yard(SITE)
        yard.open()
        teams = [(E1, E2), (E2, E3), (E3, E1)]
        missions = [
            yard.submit(*(go(f"n{i}", teams[(i + start) % 3], [f"n{i - 1}"] if i else []) for i in range(3)))
            for start in order[:count]
        ]
        finish_all(yard)
        assert all(yard.ended_well(m) for m in missions)


def finish_all(yard: Yard) -> None:
    """Let robots do what they are asked until nothing is under way; time passes when nothing else happens."""
    missions = yard.core.state.missions.values()
    for _ in range(400):
        active = [m.tasks[t] for m in missions for t in sorted(m.active)]
        if active:
            yard.now += 1.0
            yard.finish(active[0])
        elif all(m.state.ended for m in missions):
            return
        else:
            yard.wait(5.0)


teams = st.lists(st.sampled_from(ROBOTS), min_size=1, max_size=4, unique=True)


@given(
    wishes=st.lists(st.tuples(st.integers(0, 9), st.lists(teams, min_size=1, max_size=4)), min_size=2, max_size=4),
    chains=st.booleans(),
)
@settings(max_examples=40, deadline=None)
def test_no_set_of_missions_waits_for_each_other(wishes: list[tuple[int, list[list[str]]]], *, chains: bool) -> None:
    """Whatever teams are wanted, in whatever order and priority, every mission comes to its end."""
    yard = Yard(SITE)
    yard.open()
    for priority, wanted in wishes:
        yard.submit(
            *(planned(f"n{i}", HOME, team, [f"n{i - 1}"] if chains and i else []) for i, team in enumerate(wanted)),
            priority=priority,
        )
    finish_all(yard)
    stuck = [t.waiting_for for m in yard.core.state.missions.values() for t in m.tasks.values() if not t.state.ended]
    assert stuck == []
    assert all(yard.ended_well(m) for m in yard.core.state.missions.values())
