"""The scheduling site in simulated trouble: some seeds in the short form, thousands in the long one.

A failing seed prints the shortest script and history that still fail; `python -m tests.simulation SEED` runs it again.
"""

import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.simulation.aimed import AIMED
from tests.simulation.mutants import MUTANTS, mutant
from tests.simulation.run import run, shortest
from tests.simulation.script import draw

ROOT = Path(__file__).parents[1]
SHORT = 40
LONG = 5000
SHARE = 40
"""Seeds in one test."""


def failures(first: int, count: int) -> Iterator[str]:
    """Yield a report of the first seed that fails."""
    for seed in range(first, first + count):
        result = run(seed)
        if result.problems:
            yield shortest(result).report()
            return


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("first", range(0, SHORT, SHARE))
def test_every_mission_ends_and_nothing_is_lost_repeated_or_made_up(first: int) -> None:
    """Whatever is killed, cut off, lost, doubled, delayed or forged: the invariants of `oracle` hold."""
    assert not "\n".join(failures(first, SHARE))


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("first", range(SHORT, LONG, 10 * SHARE))
def test_thousands_of_other_seeds_hold_as_well(first: int) -> None:
    """The long form of the same."""
    assert not "\n".join(failures(first, 10 * SHARE))


def fingerprint(seed: int, hash_seed: str) -> str:
    """Return a digest of a seed's history, run in a process of its own."""
    program = (
        "import hashlib; from tests.simulation.run import run;"
        f"print(hashlib.sha256(chr(10).join(run({seed}).history.lines()).encode()).hexdigest())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        check=True,
        capture_output=True,
        encoding="utf-8",
    )
    return done.stdout.strip()


@pytest.mark.timeout(900)
def test_a_seed_gives_the_same_history_every_time() -> None:
    """In another process, and in whatever order that process happens to keep its sets."""
    here = hashlib.sha256("\n".join(run(3).history.lines()).encode()).hexdigest()
    assert fingerprint(3, "1") == fingerprint(3, "2") == here


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", MUTANTS)
def test_a_broken_rule_is_noticed(name: str) -> None:
    """A proof that cannot fail is none: with one rule broken, a script that is fine without shows a problem."""
    aimed = [(1, script) for script in AIMED.get(name, ())]
    with mutant(name):
        shown = next((s for s in (*aimed, *((n, draw(n)) for n in range(SHORT))) if run(*s).problems), None)
    assert shown is not None, "everything is fine with the rule broken"
    assert run(*shown).problems == []


@pytest.mark.timeout(900)
def test_a_failing_script_is_cut_down_to_what_matters() -> None:
    """What is printed is shorter than what was drawn, and fails for the same reason."""
    with mutant("scheduler_takes_one_for_the_team"):
        failed = next(r for r in (run(seed) for seed in range(40)) if r.problems)
        short = shortest(failed, budget=30)
    assert len(short.script) < len(failed.script)
    assert short.problems[0].split(":")[0] == failed.problems[0].split(":")[0]
    assert short.problems[0] in short.report()
