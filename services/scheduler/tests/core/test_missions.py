"""Missions from the instruction to the end."""

import pytest
from muster_scheduler.core.effects import RetractTask
from muster_scheduler.core.errors import NotPossibleError
from muster_scheduler.testing import Yard, planned, replayed
from muster_schemas.mission import MissionStatus, Reason, TaskStatus
from muster_schemas.plan import Plan
from muster_schemas.robot import RequestAction, SkillStatusKind
from muster_schemas.rpc import ErrorCode, MissionAction

E1, E2, T1 = "robot_excavator_01", "robot_excavator_02", "robot_dump_truck_01"
GO, DIG = "target_area_for_specific_robots", "Excavation"


def test_tasks_start_when_their_dependencies_are_done(yard: Yard) -> None:
    """Of a chain with a branch beside it, the roots start at once and the others say what they wait for."""
    mission = yard.submit(
        planned("go", GO, [E1], objects=["soil1"]),
        planned("dig", DIG, [E1], after=["go"]),
        planned("beside", GO, [T1], objects=["puddle1"]),
    )
    assert yard.tasks(mission, TaskStatus.DISPATCHED) == ["go", "beside"]
    assert mission.tasks["t2"].waiting_for == ("dependency: t1",)
    yard.finish(mission.tasks["t1"])
    assert yard.tasks(mission, TaskStatus.DISPATCHED) == ["dig", "beside"]
    yard.run(mission)
    assert yard.ended_well(mission)


def test_a_plan_whose_tasks_are_written_backwards_runs_in_order(yard: Yard) -> None:
    """A dependency on a task further down counts like any other."""
    mission = yard.submit(planned("dig", DIG, [E1], after=["go"]), planned("go", GO, [E1], objects=["soil1"]))
    assert yard.tasks(mission, TaskStatus.DISPATCHED) == ["go"]
    yard.run(mission)
    assert yard.ended_well(mission)


def test_a_mission_of_thousands_of_tasks_runs(yard: Yard) -> None:
    """The core has no limit of its own on the number of tasks."""
    quick = Yard(yard.site, check=False)
    quick.open()
    names = [f"n{i}" for i in range(2_000)]
    mission = quick.submit(*(planned(n, DIG, [E1], after=names[max(i - 1, 0) : i]) for i, n in enumerate(names)))
    quick.run(mission, seconds=1e6)
    assert quick.ended_well(mission)
    assert len(quick.starts) == 2_000


def test_an_approved_plan_runs_and_says_before_that_it_waits_for_approval(yard: Yard) -> None:
    """With approval asked for nothing starts by itself."""
    mission = yard.submit(planned("dig", DIG, [E1]), ask=True)
    assert mission.state is MissionStatus.AWAITING_APPROVAL
    assert mission.tasks["t1"].waiting_for == ("approval",)
    assert not yard.outbox
    yard.control(mission, MissionAction.APPROVE)
    yard.control(mission, MissionAction.APPROVE)
    assert yard.tasks(mission, TaskStatus.DISPATCHED) == ["dig"]


def test_an_edited_plan_takes_the_place_of_the_first(yard: Yard) -> None:
    """While it awaits approval a plan can be replaced; its old tasks are taken back."""
    mission = yard.submit(planned("dig", DIG, [E1]), planned("also", DIG, [E2]), ask=True)
    before = len(yard.events)
    yard.control(mission, MissionAction.SET_PLAN, plan=Plan(tasks=(planned("other", DIG, [E2]),)))
    assert yard.tasks(mission, TaskStatus.WAITING) == ["other"]
    again = replayed(yard.events[:before])
    retracted = [e.task_id for e in again.handle(yard.events[before]) if isinstance(e, RetractTask)]
    assert retracted == ["t1", "t2"]


def test_a_rejected_plan_is_never_run(yard: Yard) -> None:
    """It ends with a reason, and its tasks with it."""
    mission = yard.submit(planned("dig", DIG, [E1]), ask=True)
    yard.control(mission, MissionAction.REJECT, reasons=(Reason(code="no", message="Not today."),))
    assert mission.state is MissionStatus.REJECTED
    assert [r.message for r in mission.reasons] == ["Not today."]
    assert not yard.outbox


def test_a_mission_without_a_plan_waits_for_the_planner(yard: Yard) -> None:
    """The planner sets a plan or refuses; a plan set twice is set once."""
    mission = yard.submit()
    assert mission.state is MissionStatus.PLANNING
    plan = Plan(tasks=(planned("dig", DIG, [E1]),))
    yard.control(mission, MissionAction.SET_PLAN, plan=plan)
    yard.control(mission, MissionAction.SET_PLAN, plan=plan)
    assert yard.tasks(mission, TaskStatus.DISPATCHED) == ["dig"]
    refused = yard.submit()
    yard.control(refused, MissionAction.REFUSE, reasons=(Reason(code="no_instruction", message="No order."),))
    assert refused.state is MissionStatus.REJECTED


def test_what_a_state_does_not_allow_changes_nothing(yard: Yard) -> None:
    """An action at the wrong time is a conflict, and the state stays as it was."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    yard.run(mission)
    for action in (MissionAction.CANCEL, MissionAction.PAUSE, MissionAction.RESUME, MissionAction.APPROVE):
        with pytest.raises(NotPossibleError) as refused:
            yard.control(mission, action)
        assert refused.value.code is ErrorCode.CONFLICT
    assert replayed(yard.events).state == yard.core.state


def test_pause_holds_running_robots_and_new_starts_until_resume(yard: Yard) -> None:
    """Running skills are told to pause, ready tasks wait for the resume, and both go on afterwards."""
    mission = yard.submit(
        planned("go", GO, [E1], objects=["soil1"]),
        planned("beside", DIG, [E2]),
        planned("next", DIG, [E2], after=["beside"]),
    )
    yard.all_say(mission.tasks["t1"], SkillStatusKind.STARTED)
    yard.all_say(mission.tasks["t2"], SkillStatusKind.STARTED)
    yard.control(mission, MissionAction.PAUSE)
    assert {r.action for r in yard.outbox.values()} == {RequestAction.PAUSE}
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.PAUSED)
    assert mission.tasks["t1"].state is TaskStatus.PAUSED
    yard.say(E2, mission.tasks["t2"], SkillStatusKind.SUCCEEDED)
    assert mission.tasks["t3"].waiting_for == ("resume",)
    assert not yard.outbox
    yard.control(mission, MissionAction.RESUME)
    assert sorted(r.action for r in yard.outbox.values()) == [RequestAction.RESUME, RequestAction.START]
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.PROGRESS)
    assert mission.tasks["t1"].state is TaskStatus.RUNNING


def test_a_start_that_may_not_have_arrived_is_taken_back_by_a_pause(yard: Yard) -> None:
    """Asked about an attempt that it never saw, the robot refuses it for good; it is begun anew after the resume."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    yard.control(mission, MissionAction.PAUSE)
    assert [r.action for r in yard.outbox.values()] == [RequestAction.QUERY]
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.UNKNOWN)
    assert mission.tasks["t1"].state is TaskStatus.READY
    yard.control(mission, MissionAction.RESUME)
    yard.wait(2)
    assert [(r.action, r.attempt) for r in yard.outbox.values()] == [(RequestAction.START, 2)]


def test_cancel_asks_running_robots_until_they_have_stopped(yard: Yard) -> None:
    """What has not begun ends at once; the mission ends when the last robot has said its last word."""
    mission = yard.submit(
        planned("go", GO, [E1, T1], objects=["soil1"]), planned("dig", DIG, [E1], after=["go"]), planned("b", DIG, [E2])
    )
    yard.all_say(mission.tasks["t1"], SkillStatusKind.STARTED)
    yard.control(mission, MissionAction.CANCEL)
    assert mission.state is MissionStatus.RUNNING
    assert mission.tasks["t2"].state is TaskStatus.CANCELLED
    assert {r.action for r in yard.outbox.values()} == {RequestAction.CANCEL}
    assert set(mission.stopping.values()) == {"no answer yet"}
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.CANCELLED)
    yard.say(T1, mission.tasks["t1"], SkillStatusKind.SUCCEEDED)
    yard.say(E2, mission.tasks["t3"], SkillStatusKind.UNKNOWN)
    assert mission.state is MissionStatus.CANCELLED
    assert mission.stopping == {E1: "stopped", T1: "had finished", E2: "had not started"}
    yard.control(mission, MissionAction.CANCEL)
    assert not yard.outbox


def test_cancel_ends_at_once_where_no_robot_is_at_work(yard: Yard) -> None:
    """A mission in planning, before approval, or with nothing but waiting tasks."""
    yard.robot_lost(E1)
    for mission in (
        yard.submit(),
        yard.submit(planned("a", DIG, [E1]), ask=True),
        yard.submit(planned("a", DIG, [E1])),
    ):
        yard.control(mission, MissionAction.CANCEL)
        assert mission.state is MissionStatus.CANCELLED


def test_a_lost_robot_does_not_keep_a_cancelled_mission_open(yard: Yard) -> None:
    """Its outcome is unknown and said to be; when it comes back it is told to stop before anyone gets it."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    task = mission.tasks["t1"]
    yard.all_say(task, SkillStatusKind.STARTED)
    yard.robot_lost(E1)
    assert task.waiting_for == (f"robot: {E1} (lost; what it does is unknown)",)
    yard.control(mission, MissionAction.CANCEL)
    assert mission.state is MissionStatus.CANCELLED
    assert "not known" in mission.stopping[E1]
    assert [r.code for r in mission.reasons] == ["outcome_unknown"]
    other = yard.submit(planned("dig", DIG, [E1]))
    yard.robot_back(E1)
    assert [(r.action, r.mission_id) for r in yard.outbox.values()] == [(RequestAction.CANCEL, mission.mission_id)]
    assert other.tasks["t1"].waiting_for == (f"robot: {E1}",)
    yard.say(E1, task, SkillStatusKind.CANCELLED)
    assert mission.stopping[E1] == "stopped"
    assert other.tasks["t1"].state is TaskStatus.DISPATCHED


def test_a_robot_that_never_answers_a_cancel_does_not_keep_the_mission_open(yard: Yard) -> None:
    """After a while the mission ends with the robot's outcome unknown."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    yard.all_say(mission.tasks["t1"], SkillStatusKind.STARTED)
    yard.control(mission, MissionAction.CANCEL)
    yard.wait(29)
    assert mission.state is MissionStatus.RUNNING
    yard.wait(2)
    assert mission.state is MissionStatus.CANCELLED
    assert not yard.core.state.robots[E1].free


def test_revisions_only_grow(yard: Yard) -> None:
    """Whoever keeps the highest revision has the newest state."""
    mission = yard.submit(planned("go", GO, [E1], objects=["soil1"]), planned("dig", DIG, [E1], after=["go"]))
    yard.run(mission)
    seen: dict[tuple[str, ...], int] = {}
    for state in yard.published:
        key = (state.mission_id, getattr(state, "task_id", ""))
        assert state.revision > seen.get(key, -1)
        seen[key] = state.revision


def test_a_wish_that_cannot_be_changes_nothing_not_even_the_time(yard: Yard) -> None:
    """It is not in the journal, so the replay would not know of it (found by the simulation)."""
    mission = yard.submit()
    yard.now += 50.0
    with pytest.raises(NotPossibleError):
        yard.control(mission, MissionAction.RESUME)
    assert yard.core.state == replayed(yard.events).state
