"""Attempts at tasks: retries, refusals, restarts of agents, lost robots, late words."""

import pytest
from muster_scheduler.core.effects import Acknowledge, Send
from muster_scheduler.core.events import RulesObeyed, Started, TaskDispatched
from muster_scheduler.core.transitions import InvalidTransition
from muster_scheduler.testing import Yard, planned, replayed
from muster_schemas.mission import MissionStatus, TaskStatus
from muster_schemas.robot import RequestAction, SkillStatusKind

E1, E2, T1 = "robot_excavator_01", "robot_excavator_02", "robot_dump_truck_01"
GO, DIG, AVOID = "target_area_for_specific_robots", "Excavation", "avoid_areas_for_specific_robots"


def test_a_failed_drive_is_tried_once_more(yard: Yard) -> None:
    """Driving twice does no harm; the second failure is final and says why."""
    mission = yard.submit(planned("go", GO, [E1], objects=["soil1"]))
    task = mission.tasks["t1"]
    yard.say(E1, task, SkillStatusKind.FAILED, reason="stuck")
    assert (task.state, task.waiting_for) == (TaskStatus.READY, (f"retry: {E1}: stuck",))
    yard.wait(1.5)
    assert (task.state, task.attempt) == (TaskStatus.DISPATCHED, 2)
    yard.say(E1, task, SkillStatusKind.FAILED, reason="stuck again")
    assert (task.state, task.error) == (TaskStatus.FAILED, f"{E1}: stuck again")
    assert mission.state is MissionStatus.FAILED
    assert "stuck again" in mission.reasons[0].message


@pytest.mark.parametrize("kind", [SkillStatusKind.INTERRUPTED, SkillStatusKind.FAILED])
def test_a_dig_that_was_cut_short_is_never_silently_run_again(yard: Yard, kind: SkillStatusKind) -> None:
    """It has moved an unknown amount, so a person must decide."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.STARTED)
    yard.say(E1, mission.tasks["t1"], kind, reason="cut short")
    assert mission.state is MissionStatus.FAILED
    assert mission.tasks["t1"].attempt == 1


def test_what_depends_on_a_failed_task_is_skipped_and_other_branches_go_on(yard: Yard) -> None:
    """The mission fails only when everything that can still be done is done."""
    mission = yard.submit(
        planned("dig", DIG, [E1]),
        planned("after", GO, [E1], after=["dig"], objects=["soil1"]),
        planned("later", GO, [T1], after=["after", "other"], objects=["soil1"]),
        planned("other", DIG, [E2]),
        planned("more", DIG, [E2], after=["other"]),
    )
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.FAILED, reason="nothing to dig")
    assert yard.tasks(mission, TaskStatus.SKIPPED) == ["after", "later"]
    assert mission.state is MissionStatus.RUNNING
    yard.run(mission)
    assert yard.tasks(mission, TaskStatus.SUCCEEDED) == ["other", "more"]
    assert mission.state is MissionStatus.FAILED


def test_a_team_fails_together(yard: Yard) -> None:
    """When one of several robots fails the others are told to stop, and the task ends when all have."""
    mission = yard.submit(planned("go", GO, [E1, T1], objects=["soil1"]))
    task = mission.tasks["t1"]
    yard.all_say(task, SkillStatusKind.STARTED)
    yard.say(E1, task, SkillStatusKind.FAILED, reason="stuck")
    assert {(r.robot_id, r.action) for r in yard.outbox.values()} == {(T1, RequestAction.CANCEL)}
    assert task.waiting_for == (f"robot: {T1} (to stop)",)
    yard.say(T1, task, SkillStatusKind.CANCELLED)
    assert task.state is TaskStatus.READY
    yard.wait(1.5)
    assert {(r.robot_id, r.attempt) for r in yard.outbox.values()} == {(E1, 2), (T1, 2)}


def test_a_refused_start_is_tried_again_until_the_policy_says_enough(yard: Yard) -> None:
    """A refusal means that nothing moved, so even a dig may be tried again; not for ever."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    task = mission.tasks["t1"]
    for attempt in range(1, 21):
        assert task.attempt == attempt
        yard.say(E1, task, SkillStatusKind.REFUSED, reason="busy")
        yard.wait(1.5)
    assert task.state is TaskStatus.FAILED
    assert task.error == f"{E1}: busy"


def test_an_agent_that_restarts_is_asked_what_became_of_its_task(yard: Yard) -> None:
    """A later life that never saw the attempt gets a new one; nothing is assumed."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    task = mission.tasks["t1"]
    yard.robot_comes(E1)
    (request,) = yard.outbox.values()
    assert (request.action, request.boot_id) == (RequestAction.QUERY, yard.boots[E1])
    yard.say(E1, task, SkillStatusKind.UNKNOWN)
    yard.wait(1.5)
    (request,) = yard.outbox.values()
    assert (request.action, request.attempt, request.boot_id) == (RequestAction.START, 2, yard.boots[E1])


def test_an_agent_that_forgot_a_task_it_had_started_does_not_get_it_again(yard: Yard) -> None:
    """'Never seen' from a robot that had said 'started' means lost memory, not that nothing happened."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.STARTED)
    yard.robot_comes(E1)
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.UNKNOWN, seq=0)
    assert mission.state is MissionStatus.FAILED


def test_a_lost_robots_task_is_unknown_and_goes_on_when_it_is_back(yard: Yard) -> None:
    """Lost means that nothing is known: neither failed nor run elsewhere."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    task = mission.tasks["t1"]
    yard.say(E1, task, SkillStatusKind.STARTED)
    yard.robot_lost(E1)
    yard.wait(3600)
    assert task.state is TaskStatus.RUNNING
    assert task.waiting_for == (f"robot: {E1} (lost; what it does is unknown)",)
    yard.robot_back(E1)
    assert task.waiting_for == ()
    yard.say(E1, task, SkillStatusKind.SUCCEEDED)
    assert yard.ended_well(mission)


def test_late_and_repeated_words_change_nothing_and_final_ones_are_acknowledged(yard: Yard) -> None:
    """Sequence numbers and attempts tell old words from new ones; only news gets an acknowledgement by the core."""
    mission = yard.submit(planned("go", GO, [E1], objects=["soil1"]))
    task = mission.tasks["t1"]
    yard.say(E1, task, SkillStatusKind.STARTED, seq=5)
    yard.say(E1, task, SkillStatusKind.FAILED, seq=4)
    assert task.state is TaskStatus.RUNNING
    effects = yard.say(E1, task, SkillStatusKind.FAILED, seq=6)
    assert [e.ack.seq for e in effects if isinstance(e, Acknowledge)] == [6]
    yard.wait(1.5)
    before = yard.core.state.missions[mission.mission_id].tasks["t1"].revision
    assert yard.say(E1, task, SkillStatusKind.SUCCEEDED, attempt=1, seq=9) == []
    assert yard.say(E2, task, SkillStatusKind.SUCCEEDED, seq=9) == []
    assert task.revision == before


def test_a_word_of_an_earlier_life_after_a_later_one_spoke_is_late(yard: Yard) -> None:
    """Boot ids grow with time, so a delayed message of the old life is seen as such."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    task, old = mission.tasks["t1"], yard.boots[E1]
    yard.robot_comes(E1)
    yard.say(E1, task, SkillStatusKind.STARTED)
    yard.say(E1, task, SkillStatusKind.FAILED, boot_id=old, seq=1000)
    assert task.state is TaskStatus.RUNNING


def test_a_new_epoch_sends_again_what_was_not_answered(yard: Yard) -> None:
    """After a restart of the scheduler the same attempts go on, under a higher epoch."""
    mission = yard.submit(planned("dig", DIG, [E1]), planned("two", DIG, [E2]))
    yard.say(E2, mission.tasks["t2"], SkillStatusKind.STARTED)
    effects = yard.happen(Started(at=yard.now, epoch=2))
    sent = [e.request for e in effects if isinstance(e, Send)]
    assert [(r.robot_id, r.action, r.attempt, r.epoch) for r in sent] == [(E1, RequestAction.START, 1, 2)]
    assert yard.tasks(mission, TaskStatus.RUNNING) == ["two"]


def test_area_rules_are_done_when_every_robot_obeys_however_it_says_so(yard: Yard) -> None:
    """A busy robot refuses the request but obeys the published rules; that counts."""
    mission = yard.submit(planned("keep out", AVOID, [E1, T1], objects=["puddle1"]))
    task = mission.tasks["t1"]
    rules = yard.core.state.rules
    assert {(r.robot_id, r.object_name) for r in rules.rules} == {(E1, "puddle1"), (T1, "puddle1")}
    assert {r.rules_revision for r in yard.outbox.values()} == {rules.revision}
    yard.say(E1, task, SkillStatusKind.SUCCEEDED)
    yard.say(T1, task, SkillStatusKind.REFUSED, reason="busy")
    assert task.active
    yard.happen(RulesObeyed(at=yard.now, robot_id=T1, revision=rules.revision))
    assert yard.ended_well(mission)


def test_area_rules_that_a_robot_does_not_obey_fail_in_the_end(yard: Yard) -> None:
    """Nobody waits for ever."""
    mission = yard.submit(planned("keep out", AVOID, [E1], objects=["puddle1"]))
    for _ in range(2):
        yard.wait(61)
        yard.wait(31)
        yard.wait(2)
    assert mission.state is MissionStatus.FAILED


def test_what_cannot_happen_tells_the_tasks_story(yard: Yard) -> None:
    """A decision about a task that is not ready is a bug, and the error says what happened to the task before."""
    mission = yard.submit(planned("dig", DIG, [E1]))
    (decision,) = [e for e in yard.events if isinstance(e, TaskDispatched)]
    yard.run(mission)
    with pytest.raises(InvalidTransition) as error:
        replayed([*yard.events, decision])
    assert any("running -> succeeded" in line for line in error.value.story)


def test_replaying_the_events_gives_the_same_state(yard: Yard) -> None:
    """Also after failures, restarts and a cancel."""
    mission = yard.submit(planned("go", GO, [E1, T1], objects=["soil1"]), planned("dig", DIG, [E2]))
    yard.say(E1, mission.tasks["t1"], SkillStatusKind.FAILED)
    yard.robot_lost(T1)
    yard.happen(Started(at=yard.now, epoch=2))
    yard.robot_comes(T1)
    assert replayed(yard.events).state == yard.core.state
