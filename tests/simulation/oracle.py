"""The invariants, checked against the history alone.

I1  A task or mission that has ended never changes again, and every task of an accepted mission ends.
I2  One attempt starts a machine at most once; no two attempts at a task, and no two tasks of a machine, overlap.
I3  A task starts after all that it depends on has physically succeeded.
I4  A mission that was answered with success exists to the end.
I5  The replay of the journal is the state (checked in the process, see `processes`).
I6  After a cancel is answered, nothing starts at a robot that is said to have stopped, and nothing new is dispatched.
I7  After the last trouble every mission ends within a bound, and then nobody owes anybody anything.
I8  A task that is said to have succeeded was physically done by all of its robots.
I9  No machine obeys a scheduler of an earlier epoch than one that its agent has heard, nor a start that nobody sent.
I10 A skill of which a second start does harm (digging, dumping, tipping) starts at most once in all attempts together.
"""

from collections import defaultdict
from collections.abc import Iterator
from typing import Final

from muster_scheduler.core.state import REPEATABLE_VERBS
from muster_schemas.mission import MissionState, TaskState, TaskStatus
from muster_schemas.robot import SkillRequest, TaskRef
from muster_schemas.skills import PAPER_CATALOGUE

from .history import Answered, Heard, History, Motion, Published, named

SAYS_STOPPED: Final = ("stopped", "had finished", "had failed", "had not started", "stopped when its agent restarted")
FOREIGN_ATTEMPTS: Final = 100
"""Attempts from here on were never asked for by the site's scheduler."""


def problems(history: History) -> list[str]:
    """Return what contradicts the invariants."""
    return [
        *_ended_is_ended(history),
        *_one_start(history),
        *_one_at_a_time(history),
        *_order(history),
        *_after_cancel(history),
        *_truth(history),
        *_fencing(history),
        *_never_repeated(history),
    ]


def _ended_is_ended(history: History) -> Iterator[str]:
    ended: dict[tuple[str, ...], str] = {}
    for record in history.records:
        if not isinstance(record, Published):
            continue
        state = record.state
        key = (state.mission_id, state.task_id) if isinstance(state, TaskState) else (state.mission_id,)
        if key in ended and state.state != ended[key]:
            yield f"I1: {'/'.join(key)} was {ended[key]} and is {state.state} at {record.at:.3f}"
        if state.state.ended:
            ended[key] = state.state


def _one_start(history: History) -> Iterator[str]:
    started: dict[tuple[str, TaskRef], float] = {}
    for motion in history.motions():
        if motion.what == "start":
            key = (motion.robot_id, motion.ref)
            if key in started:
                first = started[key]
                yield f"I2: {motion.robot_id} started {named(motion.ref)} at {first:.3f} and at {motion.at:.3f}"
            started[key] = motion.at


def _is_rule(motion: Motion) -> bool:
    return motion.request is not None and PAPER_CATALOGUE[motion.request.skill].verb in ("avoid", "allow")


def _one_at_a_time(history: History) -> Iterator[str]:
    doing: dict[str, Motion] = {}
    for motion in history.motions():
        if motion.what != "start":
            doing = {r: m for r, m in doing.items() if r != motion.robot_id or m.ref != motion.ref}
            continue
        other = doing.get(motion.robot_id)
        if other is not None:
            yield f"I2: {motion.robot_id} started {named(motion.ref)} during {named(other.ref)} at {motion.at:.3f}"
        for robot_id, running in doing.items():
            same = (running.ref.mission_id, running.ref.task_id) == (motion.ref.mission_id, motion.ref.task_id)
            if same and running.ref.attempt != motion.ref.attempt and not _is_rule(motion):
                yield f"I2: {named(motion.ref)} starts while {robot_id} is at {named(running.ref)} at {motion.at:.3f}"
        doing[motion.robot_id] = motion


def _order(history: History) -> Iterator[str]:
    robots: dict[tuple[str, str], set[str]] = {}
    needs: dict[tuple[str, str], tuple[str, ...]] = {}
    done: dict[tuple[str, str], set[str]] = defaultdict(set)
    for record in history.records:
        if isinstance(record, Published) and isinstance(record.state, TaskState):
            state = record.state
            needs[state.mission_id, state.task_id] = state.dependencies
            robots[state.mission_id, state.task_id] = set(state.robots)
        elif isinstance(record, Motion):
            key = (record.ref.mission_id, record.ref.task_id)
            if record.what == "end" and record.outcome == "succeeded":
                done[key].add(record.robot_id)
            elif record.what == "start":
                for before in needs.get(key, ()):
                    missing = robots.get((key[0], before), set()) - done[key[0], before]
                    if missing and not _by_rules_alone(history, key[0], before):
                        yield f"I3: {named(record.ref)} starts before {before} is done by {sorted(missing)}"


def _by_rules_alone(history: History, mission_id: str, task_id: str) -> bool:
    """Return whether a task is about area rules: robots obey those by themselves, by what they read."""
    return any(
        isinstance(r, Published)
        and isinstance(r.state, TaskState)
        and (r.state.mission_id, r.state.task_id) == (mission_id, task_id)
        and PAPER_CATALOGUE[r.state.skill].verb in ("avoid", "allow")
        for r in history.records
    )


def _after_cancel(history: History) -> Iterator[str]:
    answered: dict[str, Answered] = {}
    for record in history.records:
        if isinstance(record, Answered) and record.action == "cancel":
            answered.setdefault(record.mission_id, record)
        elif isinstance(record, Motion) and record.what == "start":
            cancel = answered.get(record.ref.mission_id)
            if cancel is None:
                continue
            said = cancel.robots.get(record.robot_id)
            if said is None or said in SAYS_STOPPED:
                yield (
                    f"I6: {record.robot_id} starts {named(record.ref)} at {record.at:.3f}, after the cancel was"
                    f" answered at {cancel.at:.3f} with {said!r}"
                )


def _truth(history: History) -> Iterator[str]:
    done: dict[TaskRef, set[str]] = defaultdict(set)
    for record in history.records:
        if isinstance(record, Motion) and record.what == "end" and record.outcome == "succeeded":
            done[record.ref].add(record.robot_id)
        elif isinstance(record, Published) and isinstance(record.state, TaskState):
            state = record.state
            rule = PAPER_CATALOGUE[state.skill].verb in ("avoid", "allow")
            if state.state is TaskStatus.SUCCEEDED and not rule:
                ref = TaskRef(mission_id=state.mission_id, task_id=state.task_id, attempt=state.attempt)
                missing = set(state.robots) - done[ref]
                if missing:
                    yield f"I8: {named(ref)} is said to have succeeded, but {sorted(missing)} did not do it"


def _fencing(history: History) -> Iterator[str]:
    highest: dict[str, tuple[int, int]] = {}
    for record in history.records:
        if isinstance(record, Heard):
            memory, epoch = highest.get(record.robot_id, (-1, 0))
            epoch = epoch if memory == record.memory else 0
            highest[record.robot_id] = (record.memory, max(epoch, record.request.epoch))
        elif isinstance(record, Motion) and record.what == "start":
            _, epoch = highest.get(record.robot_id, (0, 0))
            if record.epoch < epoch:
                yield f"I9: {record.robot_id} starts {named(record.ref)} for epoch {record.epoch} after epoch {epoch}"
            if record.ref.attempt >= FOREIGN_ATTEMPTS:
                yield f"I9: {record.robot_id} starts {named(record.ref)}, which the scheduler never asked for"


def _never_repeated(history: History) -> Iterator[str]:
    started: dict[tuple[str, str, str], Motion] = {}
    for motion in history.motions():
        if motion.what == "start" and motion.request is not None:
            if PAPER_CATALOGUE[motion.request.skill].verb in REPEATABLE_VERBS:
                continue
            key = (motion.robot_id, motion.ref.mission_id, motion.ref.task_id)
            if key in started:
                first = started[key]
                yield f"I10: {motion.robot_id} starts {named(motion.ref)} at {motion.at:.3f} after {named(first.ref)}"
            started[key] = motion


def unfinished(history: History) -> list[str]:
    """Return what has not ended by the end of the run (I1, I4)."""
    tasks: dict[tuple[str, str], TaskState] = {}
    missions: dict[str, MissionState] = {}
    accepted: set[str] = set()
    for record in history.records:
        if isinstance(record, Answered) and record.action == "submit":
            accepted.add(record.mission_id)
        elif isinstance(record, Published) and isinstance(record.state, TaskState):
            tasks[record.state.mission_id, record.state.task_id] = record.state
        elif isinstance(record, Published) and isinstance(record.state, MissionState):
            missions[record.state.mission_id] = record.state
    return [
        *(f"I4: {m} was accepted and is unknown" for m in sorted(accepted - set(missions))),
        *(f"I1: {m}/{t} is {s.state} in the end" for (m, t), s in tasks.items() if not s.state.ended),
    ]


def asked_since(history: History, at: float) -> list[SkillRequest]:
    """Return the requests that reached agents since a moment: somebody still waits for an answer."""
    return [r.request for r in history.records if isinstance(r, Heard) and r.at > at]
