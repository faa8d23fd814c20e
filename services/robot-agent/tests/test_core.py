"""The core: what an agent promises about attempts, without a bus, a clock or a machine."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from muster_robot_agent.core import (
    REPEAT_S,
    Attempt,
    Begin,
    Continue,
    Core,
    Effect,
    Halt,
    Hold,
    Save,
    Say,
)
from muster_schemas.robot import RequestAction, SkillRequest, SkillStatus, SkillStatusKind, StatusAck, TaskRef

ROBOT, BOOT, SKILL = "robot_excavator_01", "boot-2", "excavator_digging"
NOW = 1000.0


def a_core(attempts: list[Attempt] | None = None, epoch: int = 0) -> Core:
    """Return the core of an excavator's agent."""
    return Core(ROBOT, BOOT, [SKILL], attempts=attempts or [], epoch=epoch)


def a_request(action: object = RequestAction.START, **rest: object) -> SkillRequest:
    """Return a request to it; `rest` overrides any field."""
    fields: dict[str, object] = {
        "action": action,
        "mission_id": "m-1",
        "task_id": "t1",
        "attempt": 1,
        "epoch": 3,
        "robot_id": ROBOT,
        "boot_id": BOOT,
        "skill": SKILL,
        "issued_at": NOW,
        "deadline": NOW + 10,
        **rest,
    }
    return SkillRequest.model_validate(fields)


def an_ack(status: SkillStatus, **rest: object) -> StatusAck:
    """Return the acknowledgement of a status."""
    fields = status.model_dump(include={"mission_id", "task_id", "attempt", "robot_id", "boot_id", "seq", "epoch"})
    return StatusAck.model_validate({**fields, **rest})


def said(effects: list[Effect]) -> list[SkillStatusKind]:
    """Return the states that are told."""
    return [e.status.state for e in effects if isinstance(e, Say)]


def begun(effects: list[Effect]) -> int:
    """Return how many physical starts are among the effects."""
    return sum(isinstance(e, Begin) for e in effects)


def last_status(effects: list[Effect]) -> SkillStatus:
    """Return the last status that is told."""
    return [e.status for e in effects if isinstance(e, Say)][-1]


def test_a_start_is_saved_then_told_then_begun() -> None:
    """`started` is in the journal before a word is said and before anything moves."""
    effects = a_core().request(a_request(), NOW)
    assert [type(e) for e in effects] == [Save, Say, Say, Begin]
    assert said(effects) == [SkillStatusKind.ACCEPTED, SkillStatusKind.STARTED]
    saved = effects[0]
    assert isinstance(saved, Save)
    assert saved.attempt.state is SkillStatusKind.STARTED
    assert saved.epoch == 3


def test_the_same_start_again_begins_nothing() -> None:
    """A repeated request gets the answer that is known, with the same sequence number."""
    core = a_core()
    first = core.request(a_request(), NOW)
    again = core.request(a_request(), NOW + 1)
    assert begun(again) == 0
    assert last_status(again).seq == last_status(first).seq


def test_the_same_start_after_the_end_gets_the_end() -> None:
    """Even after it was acknowledged and after its deadline, an attempt does not run twice."""
    core = a_core()
    core.request(a_request(), NOW)
    ended = core.ended(a_request().ref, SkillStatusKind.SUCCEEDED, None, NOW + 5)
    core.acked(an_ack(last_status(ended)))
    again = core.request(a_request(), NOW + 100)
    assert said(again) == [SkillStatusKind.SUCCEEDED]
    assert begun(again) == 0


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"boot_id": "boot-1"}, "earlier life"),
        ({"deadline": NOW - 1}, "deadline"),
        ({"skill": "dump_unloading"}, "no skill"),
        ({"epoch": 2}, "epoch 2 is over"),
    ],
)
def test_a_start_that_may_not_run_is_refused_with_a_reason(change: dict[str, object], word: str) -> None:
    """Another life, a passed deadline, an unknown skill and an old scheduler are refused, and stay refused."""
    core = a_core(epoch=3)
    refused = core.request(a_request(**change), NOW)
    assert begun(refused) == 0
    assert said(refused) == [SkillStatusKind.REFUSED]
    assert word in (last_status(refused).reason or "")
    assert said(core.request(a_request(), NOW)) == [SkillStatusKind.REFUSED]


def test_a_busy_robot_refuses_and_names_what_it_does() -> None:
    """One attempt at a time; the refusal says which."""
    core = a_core()
    core.request(a_request(), NOW)
    refused = core.request(a_request(task_id="t2"), NOW)
    assert said(refused) == [SkillStatusKind.REFUSED]
    assert "task t1 of mission m-1" in (last_status(refused).reason or "")


def test_a_machine_that_cannot_move_refuses() -> None:
    """A hindrance that the shell knows of becomes the reason."""
    refused = a_core().request(a_request(), NOW, "the machine sends no telemetry")
    assert said(refused) == [SkillStatusKind.REFUSED]
    assert last_status(refused).reason == "the machine sends no telemetry"


@pytest.mark.parametrize("change", [{"robot_id": "robot_excavator_02"}, {"attempt": 2**60}, {"epoch": 2**70}])
def test_what_is_not_for_this_robot_or_no_sane_number_is_not_answered(change: dict[str, object]) -> None:
    """Another robot's request and numbers that no journal holds have no effect at all."""
    core = a_core()
    assert core.request(a_request(**change), NOW) == []
    assert core.epoch == 0


@pytest.mark.parametrize(
    "action", [RequestAction.CANCEL, RequestAction.QUERY, RequestAction.PAUSE, RequestAction.RESUME]
)
def test_what_was_never_seen_is_unknown_and_its_later_start_is_refused(action: RequestAction) -> None:
    """Whoever asks about an attempt before its start arrives may count on its never running."""
    core = a_core()
    assert said(core.request(a_request(action), NOW)) == [SkillStatusKind.UNKNOWN]
    late_start = core.request(a_request(), NOW)
    assert begun(late_start) == 0
    assert said(late_start) == [SkillStatusKind.UNKNOWN]


def test_a_cancel_halts_once_and_ends_as_cancelled() -> None:
    """A repeated cancel, or a pause after it, changes nothing until the machine has halted."""
    core = a_core()
    ref = a_request().ref
    core.request(a_request(), NOW)
    assert isinstance(core.request(a_request(RequestAction.CANCEL), NOW)[0], Halt)
    assert not any(isinstance(e, Halt) for e in core.request(a_request(RequestAction.CANCEL), NOW))
    assert not any(isinstance(e, Hold) for e in core.request(a_request(RequestAction.PAUSE), NOW))
    assert said(core.ended(ref, SkillStatusKind.CANCELLED, None, NOW)) == [SkillStatusKind.CANCELLED]
    assert core.active is None


def test_a_fenced_scheduler_cannot_cancel() -> None:
    """A cancel from an epoch that is over gets an answer and does nothing."""
    core = a_core()
    core.request(a_request(), NOW)
    effects = core.request(a_request(RequestAction.CANCEL, epoch=2), NOW)
    assert not any(isinstance(e, Halt) for e in effects)
    assert said(effects) == [SkillStatusKind.STARTED]


def test_a_pause_is_told_when_the_machine_stands_and_resume_goes_on() -> None:
    """`paused` is said when it is true, not when it is asked for."""
    core = a_core()
    ref = a_request().ref
    core.request(a_request(), NOW)
    asked = core.request(a_request(RequestAction.PAUSE), NOW)
    assert isinstance(asked[0], Hold)
    assert said(asked) == [SkillStatusKind.STARTED]
    assert said(core.held(ref, NOW + 1)) == [SkillStatusKind.PAUSED]
    assert core.held(ref, NOW + 1) == []
    going = core.request(a_request(RequestAction.RESUME), NOW + 2)
    assert any(isinstance(e, Continue) for e in going)
    assert said(going) == [SkillStatusKind.PROGRESS]


def test_progress_is_told_in_steps_that_only_grow() -> None:
    """A repeated or smaller progress is not told, so sequence numbers stay few."""
    core = a_core()
    ref = a_request().ref
    core.request(a_request(), NOW)
    assert last_status(core.progressed(ref, 0.52, NOW)).progress == pytest.approx(0.5)
    assert core.progressed(ref, 0.52, NOW) == []
    assert core.progressed(ref, 0.1, NOW) == []


def test_a_final_status_is_repeated_until_it_is_acknowledged() -> None:
    """An acknowledgement of an earlier status is not enough."""
    core = a_core()
    core.request(a_request(), NOW)
    final = last_status(core.ended(a_request().ref, SkillStatusKind.FAILED, "stuck", NOW))
    assert core.tick(NOW + REPEAT_S / 2) == []
    assert said(core.tick(NOW + REPEAT_S)) == [SkillStatusKind.FAILED]
    assert core.acked(an_ack(final, seq=final.seq - 1)) == []
    assert said(core.tick(NOW + 2 * REPEAT_S)) == [SkillStatusKind.FAILED]
    core.acked(an_ack(final))
    assert core.tick(NOW + 9) == []


def test_a_clock_that_was_set_back_does_not_silence_the_outbox() -> None:
    """What is owed is said again even if the wall clock has jumped into the past."""
    core = a_core()
    core.request(a_request(deadline=NOW - 1), NOW)
    assert said(core.tick(NOW - 500)) == [SkillStatusKind.REFUSED]


def test_a_restart_reports_what_was_under_way_as_interrupted() -> None:
    """With a sequence number above all that the earlier life can have told, and never begun again."""
    earlier = Core(ROBOT, "boot-1", [SKILL])
    effects = earlier.request(a_request(boot_id="boot-1"), NOW)
    attempts = [e.attempt for e in effects if isinstance(e, Save)]
    last = SkillStatusKind.STARTED, 2
    for share in range(1, 101):
        for effect in earlier.progressed(a_request().ref, share / 100, NOW):
            assert isinstance(effect, Say)
            last = effect.status.state, effect.status.seq
    core = a_core(attempts, epoch=3)
    recovered = core.recover(NOW + 5)
    assert said(recovered) == [SkillStatusKind.INTERRUPTED]
    assert last_status(recovered).seq > last[1]
    assert last_status(recovered).boot_id == BOOT
    again = core.request(a_request(boot_id="boot-1"), NOW + 6)
    assert said(again) == [SkillStatusKind.INTERRUPTED]
    assert begun(again) == 0


ACTIONS = st.builds(
    a_request,
    st.sampled_from(RequestAction),
    task_id=st.sampled_from(["t1", "t2"]),
    attempt=st.integers(1, 2),
    epoch=st.integers(1, 3),
    boot_id=st.sampled_from(["boot-1", BOOT]),
    deadline=st.sampled_from([NOW - 1, NOW + 10]),
)
ENDS = st.sampled_from([SkillStatusKind.SUCCEEDED, SkillStatusKind.FAILED, SkillStatusKind.CANCELLED])


@given(st.lists(st.one_of(ACTIONS, ENDS, st.just("restart"), st.just("progress"))))
def test_whatever_comes_an_attempt_begins_once_and_its_final_word_stands(events: list[object]) -> None:
    """Any order of requests, ends and restarts: one start an attempt, and no final word is ever taken back."""
    core = a_core()
    journal: dict[TaskRef, Attempt] = {}
    starts: list[TaskRef] = []
    finals: dict[TaskRef, SkillStatusKind] = {}
    epoch = 0
    for event in events:
        if isinstance(event, SkillRequest):
            effects = core.request(event, NOW)
        elif isinstance(event, SkillStatusKind):
            effects = core.ended(core.active, event, None, NOW) if core.active else []
        elif event == "restart":
            core = a_core(list(journal.values()), epoch)
            effects = core.recover(NOW)
        else:
            effects = core.progressed(core.active, 0.5, NOW) if core.active else []
        for effect in effects:
            if isinstance(effect, Save):
                journal[effect.attempt.ref], epoch = effect.attempt, effect.epoch
            elif isinstance(effect, Begin):
                starts.append(effect.request.ref)
            elif isinstance(effect, Say) and effect.status.state.final:
                status = effect.status
                ref = TaskRef(mission_id=status.mission_id, task_id=status.task_id, attempt=status.attempt)
                assert finals.setdefault(ref, status.state) == status.state
        core.validate()
    assert all(starts.count(ref) == 1 for ref in starts)


def test_a_prepared_robot_waits_for_the_common_start() -> None:
    """It accepts and keeps still; the start of the same attempt moves it, once."""
    core = a_core()
    prepared = core.request(a_request(RequestAction.PREPARE), NOW)
    assert (said(prepared), begun(prepared)) == ([SkillStatusKind.ACCEPTED], 0)
    again = core.request(a_request(RequestAction.PREPARE), NOW)
    assert (said(again), begun(again)) == ([SkillStatusKind.ACCEPTED], 0)
    started = core.request(a_request(), NOW + 1)
    assert (said(started), begun(started)) == ([SkillStatusKind.STARTED], 1)
    assert isinstance(started[0], Save)
    assert begun(core.request(a_request(), NOW + 1)) == 0
    core.validate()


def test_a_prepared_robot_is_busy() -> None:
    """Nobody else gets it until it has been told to start or to give up."""
    core = a_core()
    core.request(a_request(RequestAction.PREPARE), NOW)
    assert said(core.request(a_request(task_id="t2"), NOW)) == [SkillStatusKind.REFUSED]
    assert said(core.request(a_request(RequestAction.CANCEL), NOW)) == [SkillStatusKind.CANCELLED]
    assert begun(core.request(a_request(task_id="t3"), NOW)) == 1
    core.validate()


def test_a_prepared_robot_that_cannot_start_says_so() -> None:
    """What has come in between counts: a stop by a person, or a start that was held up on its way."""
    for hindrance, late_s in (("stopped", 0), (None, 11)):
        core = a_core()
        core.request(a_request(RequestAction.PREPARE), NOW)
        effects = core.request(a_request(), NOW + late_s, hindrance)
        assert (said(effects), begun(effects)) == ([SkillStatusKind.REFUSED], 0)
        core.validate()


def test_a_prepared_robot_that_restarts_has_not_begun() -> None:
    """Nothing moved, so its attempt counts as refused and not as interrupted."""
    first = a_core()
    first.request(a_request(RequestAction.PREPARE), NOW)
    kept = first.attempt(a_request().ref)
    assert kept is not None
    again = a_core([kept])
    assert said(again.recover(NOW)) == [SkillStatusKind.REFUSED]
