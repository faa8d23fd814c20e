"""One run: from a script to the problems that it shows, and from a failing script to the shortest that still fails."""

import asyncio
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import pytest
from muster_bus import crash
from muster_robot_agent import agent as agent_module

from . import oracle
from .history import History
from .processes import listen_for_places
from .script import HORIZON_S, Script, Step, draw
from .site import Yard
from .virtual import DeadlockError, Troubles, virtual_time

EXPECTED_ERRORS: Final = frozenset({"journal_unavailable", "yielding"})
"""Errors that a service logs about trouble that comes from outside."""
SETTLED_S: Final = 12.0
"""So long after the last mission has ended everybody has said and done what was left, with room."""
_FAST: Final = Path("/dev/shm")
"""A disk in memory, if there is one: fsync costs nothing there."""


@dataclass
class Run:
    """What came of a script."""

    seed: int
    script: Script
    problems: list[str] = field(default_factory=list[str])
    history: History = field(default_factory=History)
    virtual_s: float = 0.0
    places: dict[str, int] = field(default_factory=dict[str, int])

    def report(self) -> str:
        """Return all that a person needs to understand a failure."""
        return "\n".join(
            [
                f"seed {self.seed}: {len(self.problems)} problems",
                *(f"  {p}" for p in self.problems[:10]),
                f"script of {len(self.script)} steps:",
                *(f"  {s}" for s in self.script),
                "history:",
                *(f"  {line}" for line in self.history.lines()),
            ]
        )


def run(seed: int, script: Script | None = None) -> Run:
    """Let a script happen and check what came of it.

    Args:
        seed: of all that the script leaves open.
        script: by default the seed's own.

    """
    script = draw(seed) if script is None else script
    folder = str(_FAST) if _FAST.is_dir() else None
    with (
        tempfile.TemporaryDirectory(prefix="muster-simulation-", dir=folder) as place,
        virtual_time(seed) as (loop, troubles),
        pytest.MonkeyPatch.context() as patch,
    ):
        asyncio.set_event_loop(loop)
        listen_for_places()
        try:
            return loop.run_until_complete(_run(seed, script, Path(place), troubles, patch))
        finally:
            crash.on_passing(None)
            asyncio.set_event_loop(None)


async def _run(seed: int, script: Script, place: Path, troubles: Troubles, patch: pytest.MonkeyPatch) -> Run:
    yard = Yard(seed, place)
    patch.setattr(agent_module, "SkillRun", yard.bodies)
    patch.setattr(agent_module, "HOUSEKEEPING_S", 0.2)
    result = Run(seed, script, history=yard.history)
    problems = result.problems
    yard.open()
    try:
        for step in script:
            await _until(yard, step.at)
            step.happen(yard)
        await _until(yard, HORIZON_S if script else 0.0)
        yard.quiet()
        stuck = await yard.finish()
        problems += [f"I7: {s}" for s in stuck]
        if not stuck:
            await asyncio.sleep(SETTLED_S)
            problems += [f"I7: {o}" for o in yard.owed()]
            problems += [
                f"I7: still asked: {r.action} {r.ref}"
                for r in oracle.asked_since(yard.history, yard.now - SETTLED_S / 2)
            ]
            problems += oracle.unfinished(yard.history)
        yard.scheduler.check()
        yard.scheduler.check_replay()
    except (AssertionError, DeadlockError) as error:
        problems.append(f"{type(error).__name__}: {error}")
    finally:
        result.virtual_s = yard.now
        await yard.close()
    problems += oracle.problems(yard.history)
    problems += [p for process in yard.processes.values() for p in process.problems]
    problems += [f"logged: {e}" for e in troubles.entries if e.get("event") not in EXPECTED_ERRORS]
    result.places = {p.name: p.places_passed for p in yard.processes.values()}
    return result


async def _until(yard: Yard, at: float) -> None:
    while yard.now < at:
        await asyncio.sleep(min(1.0, at - yard.now))
        yard.scheduler.check()


def shortest(failed: Run, runner: Callable[[int, Script], Run] = run, budget: int = 150) -> Run:
    """Return the shortest run found that fails as `failed` does: steps are left out as long as it still does.

    Args:
        failed: with at least one problem.
        runner: makes a run of a seed and a script.
        budget: so many runs at most.

    """
    best, kind = failed, _kind(failed.problems)
    size = max(1, len(best.script) // 2)
    while size >= 1:
        start = 0
        while start < len(best.script) and budget > 0:
            budget -= 1
            shorter = runner(best.seed, _without(best.script, start, size))
            if shorter.problems and _kind(shorter.problems) == kind:
                best = shorter
            else:
                start += size
        size //= 2
    return best


def _without(script: Sequence[Step], start: int, size: int) -> Script:
    return (*script[:start], *script[start + size :])


def _kind(problems: Sequence[str]) -> str:
    return problems[0].split(":")[0]
