"""What is done about a task that failed: policies from the narrow to the wide, measures one after the other."""

from typing import Any

import pytest
from muster_scheduler.core import failures
from muster_scheduler.core.errors import NotPossibleError
from muster_scheduler.core.events import Policy, Started
from muster_scheduler.core.state import Mission, Task
from muster_scheduler.testing import Yard, planned, replayed, yard_file
from muster_schemas.mission import MissionStatus, TaskStatus
from muster_schemas.plan import Plan, PlanTask
from muster_schemas.policies import FailurePolicies, FailurePolicy, Measure
from muster_schemas.robot import RequestAction, SkillStatusKind
from muster_schemas.rpc import ErrorCode, MissionAction
from muster_schemas.site import load_site

E1, E2, T1 = "robot_excavator_01", "robot_excavator_02", "robot_dump_truck_01"
GO, DIG, DUMP = "target_area_for_specific_robots", "Excavation", "ExcavatorUnloading"


def site_with(*then: Measure, **rest: Any) -> Yard:
    """Return a site whose policy has these measures, with no retries unless `rest` says so."""
    default = FailurePolicy(then=then, retries=rest.pop("retries", 0))
    yard = Yard(load_site(yard_file()), policy=Policy(failures=FailurePolicies(default=default, **rest)))
    yard.open()
    return yard


def fail(yard: Yard, task: Task, reason: str = "stuck") -> None:
    """Let a task's robots start, and fail."""
    yard.all_say(task, SkillStatusKind.STARTED)
    yard.all_say(task, SkillStatusKind.FAILED, reason=reason)


def with_policy(task: PlanTask, **policy: Any) -> PlanTask:
    """Return a planned task with a policy of its own."""
    return task.model_copy(update={"on_failure": FailurePolicy(**policy)})


def branches(*after: str) -> tuple[PlanTask, ...]:
    """Return a dig with something after it, and a drive beside them."""
    return (
        planned("dig", DIG, [E1], after=after),
        planned("dump", DUMP, [E1], after=["dig"]),
        planned("beside", GO, [T1], objects=["soil1"]),
    )


def test_the_pause_before_each_further_attempt_doubles() -> None:
    """Up to a minute; the number of attempts is the policy's."""
    yard = site_with(retries=3)
    mission = yard.submit(planned("go", GO, [E1], objects=["soil1"]))
    task = mission.tasks["t1"]
    for pause in (1.0, 2.0, 4.0):
        fail(yard, task)
        yard.wait(pause - 0.1)
        assert task.state is TaskStatus.READY
        yard.wait(0.2)
        assert task.state is TaskStatus.DISPATCHED
    fail(yard, task)
    assert (mission.state, task.attempt) == (MissionStatus.FAILED, 4)
    assert failures.pause_s(FailurePolicy(retry_after_s=1.0), 99) == 60.0


def test_soil_is_worked_again_only_where_someone_says_so() -> None:
    """Retries of the whole site do not dig twice; those of the skill or the task do."""
    yard = site_with(retries=5)
    dig = planned("dig", DIG, [E1])
    fail(yard, yard.submit(dig).tasks["t1"])
    assert not yard.outbox
    task = yard.submit(with_policy(dig, retries=1)).tasks["t1"]
    fail(yard, task)
    assert task.state is TaskStatus.READY
    by_skill = site_with(skills={"Excavation": FailurePolicy(retries=2, timeout_s=77)})
    task = by_skill.submit(dig).tasks["t1"]
    assert [r.timeout_s for r in by_skill.outbox.values()] == [77]
    fail(by_skill, task)
    assert task.state is TaskStatus.READY


def test_a_task_that_failed_is_given_to_another_able_robot() -> None:
    """Where the plan leaves the choice open; the whole chain goes with it."""
    yard = site_with(Measure.REASSIGN)
    mission = yard.submit(
        planned("go", GO, types=["excavator"], count=1, objects=["soil1"]),
        planned("dig", DIG, types=["excavator"], count=1, after=["go"]),
    )
    first = mission.tasks["t1"].robots
    fail(yard, mission.tasks["t1"])
    second = mission.tasks["t1"].robots
    assert second
    assert second != first
    assert mission.tasks["t1"].state is TaskStatus.DISPATCHED
    yard.finish(mission.tasks["t1"])
    assert mission.tasks["t2"].robots == second
    fail(yard, mission.tasks["t2"])
    assert mission.state is MissionStatus.FAILED, "its chain had begun, so the choice could not move"


def test_a_named_robots_task_is_given_to_nobody_else() -> None:
    """Whoever wrote the plan meant that robot."""
    yard = site_with(Measure.REASSIGN)
    mission = yard.submit(planned("go", GO, [E1], objects=["soil1"]))
    fail(yard, mission.tasks["t1"])
    assert mission.state is MissionStatus.FAILED


def test_a_lost_robots_work_goes_to_another_after_the_sites_patience() -> None:
    """Before that it waits; the lost robot is told to stop and gets nothing new before it has answered."""
    yard = site_with(Measure.REASSIGN, lost_after_s=20)
    mission = yard.submit(planned("go", GO, types=["excavator"], count=1, objects=["soil1"]))
    task = mission.tasks["t1"]
    (lost,) = task.robots
    yard.all_say(task, SkillStatusKind.STARTED)
    yard.robot_lost(lost)
    yard.wait(19)
    assert (task.state, task.robots) == (TaskStatus.RUNNING, (lost,))
    yard.wait(2)
    (other,) = task.robots
    assert (task.state, other != lost, task.attempt) == (TaskStatus.DISPATCHED, True, 2)
    yard.robot_back(lost)
    assert {r.action for (robot, _), r in yard.outbox.items() if robot == lost} == {RequestAction.CANCEL}
    assert not yard.core.state.robots[lost].free
    yard.run(mission)
    assert yard.ended_well(mission)


def test_the_rest_is_planned_anew_and_other_branches_go_on() -> None:
    """The planner is told what was done, what failed and why; finished tasks stay, and the mission succeeds."""
    yard = site_with(Measure.REPLAN)
    mission = yard.submit(planned("go", GO, [E1], objects=["soil1"]), *branches("go"))
    yard.finish(mission.tasks["t1"])
    dig = mission.tasks["t2"]
    fail(yard, dig, "nothing to dig")
    question = yard.questions[dig.key]
    assert [t.task for t in question.done] == ["go"]
    assert [t.task for t in question.going_on] == ["beside"]
    assert (question.failed.task, [t.task for t in question.rest]) == ("dig", ["dump"])
    assert "nothing to dig" in question.error
    assert dig.waiting_for == (f"replan: {E1}: nothing to dig",)
    yard.finish(mission.tasks["t4"])
    yard.answer(dig.key, planned("dig", DIG, [E2]), planned("dump", DUMP, [E2], after=["dig"]))
    assert [(t.name, t.state) for t in mission.tasks.values()] == [
        ("go", TaskStatus.SUCCEEDED),
        ("dig", TaskStatus.FAILED),
        ("dump", TaskStatus.SKIPPED),
        ("beside", TaskStatus.SUCCEEDED),
        ("dig_2", TaskStatus.DISPATCHED),
        ("dump_2", TaskStatus.WAITING),
    ]
    assert [t.task for t in mission.plan or ()] == ["go", "beside", "dig_2", "dump_2"]
    yard.run(mission)
    assert yard.ended_well(mission)
    assert replayed(yard.events).state == yard.core.state


def test_new_tasks_wait_for_what_the_old_ones_had_to_wait_for() -> None:
    """A branch that still goes on keeps its place before what comes after it."""
    yard = site_with(Measure.REPLAN)
    mission = yard.submit(
        planned("dig", DIG, [E1]),
        planned("beside", GO, [T1], objects=["soil1"]),
        planned("dump", DUMP, [E1], after=["dig", "beside"]),
    )
    fail(yard, mission.tasks["t1"])
    yard.answer(mission.tasks["t1"].key, planned("again", DIG, [E2]))
    assert mission.tasks["t4"].waiting_for == ("dependency: t2",)
    yard.run(mission)
    assert yard.ended_well(mission)


def test_the_number_of_new_plans_is_limited_and_none_is_an_answer() -> None:
    """Then the next measure is taken, at last the task fails with both reasons."""
    yard = site_with(Measure.REPLAN, Measure.REPLAN, replans=1)
    mission = yard.submit(*branches())
    fail(yard, mission.tasks["t1"])
    yard.answer(mission.tasks["t1"].key)
    assert mission.tasks["t1"].state is TaskStatus.FAILED
    assert mission.tasks["t1"].error == f"{E1}: stuck; no new plan: No way."
    assert mission.state is MissionStatus.RUNNING


def test_a_new_plan_waits_for_approval_where_a_person_wants_to_see_plans() -> None:
    """Until then the failed task says so; a turned-down plan leads to the next measure."""
    yard = site_with(Measure.REPLAN, Measure.ASK)
    mission = yard.submit(*branches(), ask=True)
    yard.control(mission, MissionAction.APPROVE)
    dig = mission.tasks["t1"]
    fail(yard, dig)
    yard.answer(dig.key, planned("dig", DIG, [E2]))
    assert dig.waiting_for[0].startswith("approval: ")
    yard.control(mission, MissionAction.REJECT)
    assert dig.waiting_for[0].startswith("decision: ")
    yard.control(mission, MissionAction.REPLAN, task_id="t1")
    yard.answer(dig.key, planned("dig", DIG, [E2]))
    yard.control(mission, MissionAction.APPROVE)
    yard.run(mission)
    assert yard.ended_well(mission)


@pytest.mark.parametrize(
    ("action", "states"),
    [
        (MissionAction.RETRY, ["dispatched", "waiting"]),
        (MissionAction.SKIP, ["skipped", "dispatched"]),
        (MissionAction.REPLAN, ["ready", "waiting"]),
        (MissionAction.CANCEL, ["cancelled", "cancelled"]),
    ],
)
def test_a_person_who_is_asked_says_what_now(action: MissionAction, states: list[str]) -> None:
    """The task is held with its reason until then; other branches go on."""
    yard = site_with(Measure.ASK)
    mission = yard.submit(*branches())
    dig = mission.tasks["t1"]
    fail(yard, dig)
    assert (dig.state, dig.waiting_for) == (TaskStatus.READY, (f"decision: {E1}: stuck",))
    yard.finish(mission.tasks["t3"])
    yard.wait(1000)
    assert mission.state is MissionStatus.RUNNING
    yard.control(mission, action, task_id="t1")
    assert [mission.tasks[t].state.value for t in ("t1", "t2")] == states
    if action is MissionAction.REPLAN:
        yard.answer(dig.key)
        assert dig.waiting_for[0].startswith("decision: ")
        yard.control(mission, MissionAction.RETRY, task_id="t1")
    if action is not MissionAction.CANCEL:
        yard.run(mission)
        assert yard.ended_well(mission)


def test_only_a_task_that_waits_for_a_decision_can_be_decided(yard: Yard) -> None:
    """Anything else is refused and changes nothing."""
    mission = yard.submit(*branches())
    for task_id, code in (("t1", ErrorCode.CONFLICT), ("t9", ErrorCode.NOT_FOUND), (None, ErrorCode.NOT_FOUND)):
        with pytest.raises(NotPossibleError) as refused:
            yard.control(mission, MissionAction.SKIP, task_id=task_id)
        assert refused.value.code is code


def test_a_question_without_an_answer_is_asked_again_after_a_restart() -> None:
    """And an answer that comes after the mission was cancelled is none."""
    yard = site_with(Measure.REPLAN)
    mission = yard.submit(*branches())
    fail(yard, mission.tasks["t1"])
    question = yard.questions.pop(mission.tasks["t1"].key)
    yard.happen(Started(at=yard.now, epoch=2, policy=yard.core.state.policy))
    assert yard.questions[mission.tasks["t1"].key] == question
    yard.control(mission, MissionAction.CANCEL)
    tasks = dict(mission.tasks)
    yard.answer(mission.tasks["t1"].key, planned("dig", DIG, [E2]))
    assert mission.tasks == tasks


def test_a_plan_is_edited_only_as_it_stands(yard: Yard) -> None:
    """An edit or approval of a plan that has changed since is refused, and changes nothing."""
    mission = yard.submit(planned("dig", DIG, [E1]), ask=True)
    seen = mission.plan_revision
    yard.control(mission, MissionAction.SET_PLAN, plan=Plan(tasks=(planned("dig", DIG, [E2]),)), plan_revision=seen)
    assert mission.state is MissionStatus.AWAITING_APPROVAL
    for action in (MissionAction.SET_PLAN, MissionAction.APPROVE):
        with pytest.raises(NotPossibleError) as refused:
            yard.control(mission, action, plan=Plan(tasks=branches()), plan_revision=seen)
        assert refused.value.code is ErrorCode.CONFLICT
    assert [t.named for t in mission.tasks.values()] == [(E2,)]
    yard.control(mission, MissionAction.APPROVE, plan_revision=mission.plan_revision)
    assert _dispatched(yard, mission) == ["dig"]


def _dispatched(yard: Yard, mission: Mission) -> list[str]:
    return yard.tasks(mission, TaskStatus.DISPATCHED)
