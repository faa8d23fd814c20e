"""Ways to break the rules that the proof is about: the simulation must notice each of them, or it proves nothing.

A mutant breaks one rule of the running code while it is entered; its docstring says what the program then does.
"""

# The rules are made of what modules keep to themselves.
# pyright: reportPrivateUsage=false, reportPrivateImportUsage=false

import contextlib
from collections.abc import Callable, Generator, Sequence
from typing import Any, Final

import pytest
from muster_robot_agent.agent import RobotAgent
from muster_robot_agent.core import Attempt, Begin
from muster_robot_agent.core import Core as AgentCore
from muster_robot_agent.core import Effect as AgentEffect
from muster_robot_agent.journal import Journal as AgentJournal
from muster_scheduler.core import attempts, outcomes
from muster_scheduler.core.effects import Acknowledge, Effect
from muster_scheduler.core.state import Run, State, Task
from muster_scheduler.core.turn import Turn
from muster_scheduler.engine import Engine
from muster_scheduler.outbox import Outbox
from muster_schemas.robot import SkillRequest, SkillStatus, SkillStatusKind

Patch = pytest.MonkeyPatch
MUTANTS: Final[dict[str, Callable[[Patch], None]]] = {}


def _mutant(change: Callable[[Patch], None]) -> Callable[[Patch], None]:
    MUTANTS[change.__name__.removeprefix("_")] = change
    return change


@contextlib.contextmanager
def mutant(name: str) -> Generator[None]:
    """Have one rule broken while entered."""
    with pytest.MonkeyPatch.context() as patch:
        MUTANTS[name](patch)
        yield


def nothing(*_args: object) -> None:
    """Do nothing, in place of something."""


@_mutant
def _scheduler_sends_before_it_commits(patch: Patch) -> None:
    """Send and acknowledge, then write."""
    finish = Engine._finish

    def early(engine: Any, events: Any, effects: Sequence[Effect], happened: Any) -> None:
        engine._outbox.carry_out(effects, engine.now(), engine.now())
        finish(engine, events, [], happened)

    patch.setattr(Engine, "_finish", early)


@_mutant
def _scheduler_acknowledges_before_it_commits(patch: Patch) -> None:
    """Acknowledge a final word, then write it down."""
    finish = Engine._finish

    def early(engine: Any, events: Any, effects: Sequence[Effect], happened: Any) -> None:
        acks = [e for e in effects if isinstance(e, Acknowledge)]
        engine._outbox.carry_out(acks, engine.now(), engine.now())
        finish(engine, events, [e for e in effects if e not in acks], happened)

    patch.setattr(Engine, "_finish", early)


@_mutant
def _agent_does_not_journal_started(patch: Patch) -> None:
    """Write down only how attempts end."""
    save = AgentJournal.save

    def save_ends(journal: AgentJournal, attempt: Attempt, epoch: int) -> None:
        if attempt.state.final:
            save(journal, attempt, epoch)

    patch.setattr(AgentJournal, "save", save_ends)


@_mutant
def _agent_moves_before_it_journals(patch: Patch) -> None:
    """Begin, then write that it has begun."""
    carry_out = RobotAgent._carry_out

    def moved_first(agent: Any, effects: list[AgentEffect]) -> None:
        carry_out(agent, sorted(effects, key=lambda e: not isinstance(e, Begin)))

    patch.setattr(RobotAgent, "_carry_out", moved_first)


@_mutant
def _agent_takes_a_repetition_for_new(patch: Patch) -> None:
    """Forget an attempt once its end is acknowledged."""
    request = AgentCore.request

    def forgetful(core: Any, asked: SkillRequest, now: float, hindrance: str | None = None) -> list[AgentEffect]:
        known = core._attempts.get(asked.ref)
        if known is not None and known.acked:
            del core._attempts[asked.ref]
        return request(core, asked, now, hindrance)

    patch.setattr(AgentCore, "request", forgetful)


@_mutant
def _agent_does_not_check_the_epoch(patch: Patch) -> None:
    """Obey a scheduler that has been replaced."""
    refusal = AgentCore._refusal

    def lenient(core: AgentCore, asked: SkillRequest, now: float, **_rest: bool) -> str | None:
        return refusal(core, asked, now, fenced=False)

    patch.setattr(AgentCore, "_refusal", lenient)


@_mutant
def _agent_does_not_check_the_life(patch: Patch) -> None:
    """Obey what was meant for an earlier life."""
    refusal = AgentCore._refusal

    def lenient(core: AgentCore, asked: SkillRequest, now: float, *, fenced: bool) -> str | None:
        return refusal(core, asked.model_copy(update={"boot_id": core.boot_id}), now, fenced=fenced)

    patch.setattr(AgentCore, "_refusal", lenient)


@_mutant
def _agent_does_not_check_the_deadline(patch: Patch) -> None:
    """Obey what comes long after it was sent."""
    refusal = AgentCore._refusal

    def lenient(core: AgentCore, asked: SkillRequest, now: float, *, fenced: bool) -> str | None:
        return refusal(core, asked.model_copy(update={"deadline": now + 1.0}), now, fenced=fenced)

    patch.setattr(AgentCore, "_refusal", lenient)


@_mutant
def _agent_does_not_report_an_interruption(patch: Patch) -> None:
    """Come back as if what was under way still were."""

    def silent(_core: AgentCore, _now: float) -> list[AgentEffect]:
        return []

    patch.setattr(AgentCore, "recover", silent)


@_mutant
def _agent_says_its_final_word_once(patch: Patch) -> None:
    """Do not wait for the acknowledgement."""

    def silent(_core: AgentCore, _now: float) -> list[AgentEffect]:
        return []

    patch.setattr(AgentCore, "tick", silent)


@_mutant
def _scheduler_asks_once(patch: Patch) -> None:
    """Do not wait for the answer."""
    patch.setattr(Outbox, "repeat", nothing)


@_mutant
def _scheduler_believes_late_words(patch: Patch) -> None:
    """Take any word about a task that is under way, whichever life, attempt or order it comes from."""

    def believe(state: State, status: SkillStatus) -> bool:
        task = state.task((status.mission_id, status.task_id))
        run = task.runs.get(status.robot_id) if task is not None and task.active else None
        return status.robot_id in state.robots and run is not None and not run.over

    patch.setattr(attempts, "is_news", believe)


@_mutant
def _scheduler_takes_a_lost_robot_for_free(patch: Patch) -> None:
    """Forget that a robot may still be at what was closed without its word."""
    patch.setattr(attempts, "loosen", nothing)


@_mutant
def _scheduler_takes_one_for_the_team(patch: Patch) -> None:
    """Take a task for done when the first of its robots is."""
    settle = attempts.settle

    def hasty(turn: Turn, task: Task) -> None:
        if task.active and any(r.state is SkillStatusKind.SUCCEEDED for r in task.runs.values()):
            for run in task.runs.values():
                run.state = SkillStatusKind.SUCCEEDED
        settle(turn, task)

    patch.setattr(attempts, "settle", hasty)


@_mutant
def _scheduler_takes_one_dependency_for_all(patch: Patch) -> None:
    """Start a task when the first of those before it is done."""
    succeeded = outcomes.task_succeeded

    def hasty(turn: Turn, mission: Any, task: Task) -> None:
        for after_id in mission.graph.successors(task.task_id):
            mission.tasks[after_id].unmet.intersection_update({task.task_id})
        succeeded(turn, mission, task)

    patch.setattr(outcomes, "task_succeeded", hasty)


@_mutant
def _scheduler_promises_a_stop(patch: Patch) -> None:
    """Say that a robot stopped as soon as it is asked to."""
    last_word = outcomes.last_word

    def hopeful(run: Run) -> str:
        return "stopped" if last_word(run) == outcomes.NO_WORD else last_word(run)

    patch.setattr(outcomes, "last_word", hopeful)


@_mutant
def _scheduler_knows_what_its_journal_does_not(patch: Patch) -> None:
    """Change the state without an event."""
    handle = Engine._handle

    def leaky(engine: Any, event: Any) -> tuple[list[Any], list[Effect]]:
        done = handle(engine, event)
        engine.core.state.objects.add("ghost")
        return done

    patch.setattr(Engine, "_handle", leaky)
