"""The agent's own journal in SQLite: attempts (their unacknowledged final words are the outbox) and the highest epoch.

`synchronous=FULL` with a write-ahead log: what a returned call wrote survives a crash of the process and of the power.
"""

import sqlite3
from pathlib import Path
from types import TracebackType
from typing import Self

from muster_schemas.ids import check_id
from muster_schemas.robot import SkillStatusKind, TaskRef

from .core import Attempt

KEEP_ACKED_S = 7 * 86_400
"""How long an acknowledged attempt is remembered after its deadline; a start that late is refused by the deadline."""

_SCHEMA = """
CREATE TABLE IF NOT EXISTS attempts (
    mission_id TEXT NOT NULL, task_id TEXT NOT NULL, attempt INTEGER NOT NULL, skill TEXT NOT NULL,
    epoch INTEGER NOT NULL, state TEXT NOT NULL, seq INTEGER NOT NULL, deadline REAL NOT NULL,
    progress REAL NOT NULL, reason TEXT, acked INTEGER NOT NULL,
    PRIMARY KEY (mission_id, task_id, attempt)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS numbers (name TEXT PRIMARY KEY, value REAL NOT NULL) WITHOUT ROWID;
"""


class JournalError(RuntimeError):
    """The journal cannot be used; the message says which file and why."""


class Journal:
    """One robot's journal; a context manager that opens `<folder>/agent-<robot_id>.sqlite3`."""

    def __init__(self, folder: Path, robot_id: str) -> None:
        self.path = folder / f"agent-{check_id(robot_id, 'robot')}.sqlite3"
        self._db: sqlite3.Connection | None = None

    def __enter__(self) -> Self:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            db = sqlite3.connect(self.path, isolation_level=None)
            db.execute("PRAGMA journal_mode=WAL")
            db.execute("PRAGMA synchronous=FULL")
            db.execute("PRAGMA cache_size=-128")  # kB; one process may hold hundreds of journals
            db.executescript(_SCHEMA)
        except (OSError, sqlite3.Error) as error:
            raise JournalError(
                f"cannot open the journal {self.path}: {error}; move it away or free the disk"
            ) from error
        self._db = db
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._db is not None:
            self._db.close()
            self._db = None

    @property
    def _open(self) -> sqlite3.Connection:
        if self._db is None:
            raise JournalError(f"the journal {self.path} is not open")
        return self._db

    def save(self, attempt: Attempt, epoch: int) -> None:
        """Commit one attempt and the highest epoch together.

        Raises:
            JournalError: the disk refused; nothing of it is stored.

        """
        ref = attempt.ref
        row = (
            *(ref.mission_id, ref.task_id, ref.attempt, attempt.skill, attempt.epoch, attempt.state.value),
            *(attempt.seq, attempt.deadline, attempt.progress, attempt.reason, int(attempt.acked)),
        )
        try:
            with self._open as db:
                db.execute("BEGIN IMMEDIATE")
                db.execute("INSERT OR REPLACE INTO attempts VALUES (?,?,?,?,?,?,?,?,?,?,?)", row)
                db.execute("INSERT OR REPLACE INTO numbers VALUES ('epoch', ?)", (epoch,))
        except sqlite3.Error as error:
            raise JournalError(f"cannot write the journal {self.path}: {error}") from error

    def keep_number(self, name: str, value: float) -> None:
        """Commit a number under a name.

        Raises:
            JournalError: the disk refused.

        """
        try:
            self._open.execute("INSERT OR REPLACE INTO numbers VALUES (?, ?)", (name, value))
        except sqlite3.Error as error:
            raise JournalError(f"cannot write the journal {self.path}: {error}") from error

    def number(self, name: str) -> float | None:
        """Return the number kept under a name, or None."""
        row = self._open.execute("SELECT value FROM numbers WHERE name = ?", (name,)).fetchone()
        return None if row is None else float(row[0])

    def epoch(self) -> int:
        """Return the highest epoch seen."""
        return int(self.number("epoch") or 0)

    def attempts(self) -> list[Attempt]:
        """Return every remembered attempt.

        Raises:
            JournalError: the file holds something else.

        """
        try:
            rows = self._open.execute("SELECT * FROM attempts").fetchall()
            return [
                Attempt(
                    ref=TaskRef(mission_id=row[0], task_id=row[1], attempt=row[2]),
                    skill=row[3],
                    epoch=row[4],
                    state=SkillStatusKind(row[5]),
                    seq=row[6],
                    deadline=row[7],
                    progress=row[8],
                    reason=row[9],
                    acked=bool(row[10]),
                )
                for row in rows
            ]
        except (sqlite3.Error, ValueError) as error:
            raise JournalError(f"the journal {self.path} is damaged: {error}; move it away to start afresh") from error

    def prune(self, now: float) -> int:
        """Forget acknowledged attempts whose deadline is long over; return how many."""
        cursor = self._open.execute("DELETE FROM attempts WHERE acked AND deadline < ?", (now - KEEP_ACKED_S,))
        return cursor.rowcount
