"""The journal: what survives a crash at any point."""

import json
import resource
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from muster_robot_agent.core import Attempt, Begin, Core, Save, Say
from muster_robot_agent.journal import KEEP_ACKED_S, Journal, JournalError
from muster_robot_agent.testing import request
from muster_schemas.ids import InvalidIdError
from muster_schemas.robot import SkillStatusKind, TaskRef

ROBOT = "robot_excavator_01"
CRASHING = Path(__file__).with_name("crashing_agent.py")


def an_attempt(**rest: object) -> Attempt:
    """Return an attempt that is under way; `rest` overrides any field."""
    fields: dict[str, object] = {
        "ref": TaskRef(mission_id="m-1", task_id="t1", attempt=1),
        "skill": "excavator_digging",
        "epoch": 4,
        "state": SkillStatusKind.STARTED,
        "seq": 2,
        "deadline": 50.0,
        **rest,
    }
    return Attempt(**fields)  # pyright: ignore[reportArgumentType]


def test_what_was_saved_is_there_after_reopening(tmp_path: Path) -> None:
    """Attempts, the highest epoch and kept numbers come back as they were."""
    attempt = an_attempt(reason="why", progress=0.5, acked=True)
    with Journal(tmp_path, ROBOT) as journal:
        journal.save(attempt, 7)
        journal.keep_number("arrival_soil_m3", 0.25)
    with Journal(tmp_path, ROBOT) as journal:
        assert journal.attempts() == [attempt]
        assert journal.epoch() == 7
        assert journal.number("arrival_soil_m3") == pytest.approx(0.25)


def test_every_commit_is_flushed_to_the_disk(tmp_path: Path) -> None:
    """The write-ahead log with full synchronisation: a power cut loses nothing that was promised."""
    with Journal(tmp_path, ROBOT) as journal:
        db = journal._open  # pyright: ignore[reportPrivateUsage]
        assert db.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert db.execute("PRAGMA synchronous").fetchone() == (2,)


def test_only_acknowledged_attempts_of_long_ago_are_forgotten(tmp_path: Path) -> None:
    """An outbox is never pruned, however old."""
    old = an_attempt(ref=TaskRef(mission_id="m-1", task_id="t2", attempt=1), acked=True)
    with Journal(tmp_path, ROBOT) as journal:
        journal.save(an_attempt(), 1)
        journal.save(old, 1)
        assert journal.prune(old.deadline + KEEP_ACKED_S - 1) == 0
        assert journal.prune(old.deadline + KEEP_ACKED_S + 1) == 1
        assert journal.attempts() == [an_attempt()]


def test_a_robot_id_cannot_lead_out_of_the_folder(tmp_path: Path) -> None:
    """The file's name is made of a checked id only."""
    with pytest.raises(InvalidIdError):
        Journal(tmp_path, "../elsewhere")


def test_a_damaged_journal_says_what_to_do(tmp_path: Path) -> None:
    """A file that is no database is named in the error, and is not overwritten."""
    file = tmp_path / f"agent-{ROBOT}.sqlite3"
    file.write_bytes(b"this is no database, but long enough to be taken for one" * 40)
    with pytest.raises(JournalError, match="move it away"), Journal(tmp_path, ROBOT):
        pass
    assert file.read_bytes().startswith(b"this is no database")


def test_a_journal_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    """Another process that holds the file makes the save fail loudly instead of promising what is not stored."""
    with Journal(tmp_path, ROBOT) as journal:
        journal._open.execute("PRAGMA busy_timeout = 50")  # pyright: ignore[reportPrivateUsage]
        other = sqlite3.connect(journal.path, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(JournalError, match="cannot write"):
            journal.save(an_attempt(), 1)
        other.execute("ROLLBACK")
        other.close()
        assert journal.attempts() == []


def test_a_full_disk_takes_nothing_of_a_start_and_the_machine_stays_where_it_is(tmp_path: Path) -> None:
    """The commit stands before the motion, so its error comes first; with room again the same start is a new one."""
    start = request(ROBOT, "excavator_digging")
    with Journal(tmp_path, ROBOT) as journal:
        core = Core(ROBOT, start.boot_id, [start.skill], attempts=journal.attempts(), epoch=journal.epoch())
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024, limits[1]))
        first = core.request(start, 1.0)[0]
        assert isinstance(first, Save)
        try:
            with pytest.raises(JournalError, match="cannot write"):
                journal.save(first.attempt, first.epoch)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    with Journal(tmp_path, ROBOT) as journal:
        again = Core(ROBOT, start.boot_id, [start.skill], attempts=journal.attempts(), epoch=journal.epoch())
        assert any(isinstance(e, Begin) for e in again.request(start, 1.0))


@pytest.mark.parametrize("effects", range(5))
def test_killed_at_any_point_of_a_start_it_starts_at_most_once(tmp_path: Path, effects: int) -> None:
    """Kill -9 around `started`, come back, get the same request again: never a second physical start."""
    history = tmp_path / "history.jsonl"
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, str(CRASHING), str(tmp_path), str(history), str(effects)], check=False, timeout=240
        )
        assert done.returncode == -signal.SIGKILL
    starts = [json.loads(line) for line in history.read_text().splitlines()] if history.exists() else []
    assert len(starts) == (1 if effects == 4 else 0)
    with Journal(tmp_path, ROBOT) as journal:
        core = Core(ROBOT, "boot-later", ["excavator_digging"], attempts=journal.attempts(), epoch=journal.epoch())
        told = [e.status.state for e in [*core.recover(2.0), *core.tick(9.0)] if isinstance(e, Say)]
        expected = {SkillStatusKind.INTERRUPTED} if effects >= 1 else set[SkillStatusKind]()
        assert set(told) == expected
        if effects >= 1:
            again = core.request(request(ROBOT, "excavator_digging"), 10.0)
            assert [e.status.state for e in again if isinstance(e, Say)] == [SkillStatusKind.INTERRUPTED]
