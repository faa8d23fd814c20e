"""The journal in one SQLite file: WAL, and one fsync for each batch (`synchronous=FULL`); a witness lies beside it."""

import contextlib
import fcntl
import os
import sqlite3
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import Final, Self

from muster_schemas.mission import MissionStatus

from .port import (
    ArchivedRow,
    EventRow,
    JournalCorruptError,
    JournalError,
    JournalUnavailableError,
    SnapshotRow,
)
from .witness import Witness, Witnessed

FORMAT: Final = "2"
READABLE: Final = ("1", FORMAT)
_TABLES: Final = """
CREATE TABLE IF NOT EXISTS events (seq INTEGER PRIMARY KEY, body BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;
CREATE TABLE IF NOT EXISTS snapshots (
    seq INTEGER PRIMARY KEY, event_checksum INTEGER NOT NULL, body BLOB NOT NULL, checksum INTEGER NOT NULL
) STRICT;
CREATE TABLE IF NOT EXISTS archive (
    mission_id TEXT PRIMARY KEY, number INTEGER NOT NULL, state TEXT NOT NULL, idempotency_key TEXT, body BLOB NOT NULL
) STRICT;
CREATE INDEX IF NOT EXISTS archive_numbers ON archive (number);
CREATE INDEX IF NOT EXISTS archive_keys ON archive (idempotency_key) WHERE idempotency_key IS NOT NULL;
"""


class SqliteStore:
    """One writer's hold on the file. Close it, or leave it to the end of the process."""

    def __init__(
        self, connection: sqlite3.Connection, path: Path, lock: int | None = None, witness: Witness | None = None
    ) -> None:
        """Without a lock and a witness it is for reading only."""
        self._db = connection
        self._path = path
        self._lock = lock
        self._witness = witness

    @classmethod
    def open(cls, directory: Path, site: str) -> Self:
        """Take the journal of a site, or begin one.

        Raises:
            JournalError: another process has it, it is another site's, or the disk does not allow it.
            JournalCorruptError: SQLite finds it damaged.

        """
        path = directory / "journal.sqlite"
        try:
            directory.mkdir(parents=True, exist_ok=True)
            lock = os.open(directory / "journal.lock", os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise JournalError(f"cannot write in {directory}: {error.strerror}") from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(lock)
            raise JournalError(f"another scheduler holds the journal in {directory}; stop it first") from error
        with contextlib.ExitStack() as undo:
            undo.callback(os.close, lock)
            try:
                connection = sqlite3.connect(path, isolation_level=None)
                undo.callback(connection.close)
                _prepare(connection, path, site)
                witness = Witness(directory / "journal.witness")
            except sqlite3.Error as error:
                raise _corrupt(path, str(error)) from error
            except OSError as error:
                raise JournalError(f"cannot write in {directory}: {error.strerror}") from error
            undo.pop_all()
        return cls(connection, path, lock, witness)

    @classmethod
    def read(cls, directory: Path, site: str) -> Self:
        """Return the journal of a site, which another process may hold, for reading only.

        Raises:
            JournalError: there is none, or it is another site's.

        """
        path = directory / "journal.sqlite"
        try:
            connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None)
            about = dict(connection.execute("SELECT name, value FROM about"))
        except sqlite3.Error as error:
            raise JournalError(f"cannot read {path}: {error}") from error
        _check_about(about, path, site)
        return cls(connection, path)

    @property
    def where(self) -> str:
        """The file."""
        return str(self._path)

    def events(self, after: int) -> Iterator[EventRow]:
        """Yield the events that follow `after`, in order."""
        query = "SELECT seq, body, checksum FROM events WHERE seq > ? ORDER BY seq"
        witnessed = self._witnessed()
        last = after
        with self._reading():
            for seq, body, checksum in self._db.execute(query, (after,)):
                yield EventRow(seq, body, checksum)
                last = seq
                if seq == witnessed.seq and checksum != witnessed.checksum:
                    raise _lost(self._path, f"event {seq} is another than the one that was committed")
        if last < witnessed.seq:
            raise _lost(self._path, f"events {last + 1} to {witnessed.seq} were committed and are missing")

    def append(self, rows: Sequence[EventRow]) -> None:
        """Add events in one transaction."""
        with self._writing():
            self._db.executemany("INSERT INTO events (seq, body, checksum) VALUES (?, ?, ?)", rows)
        if self._witness is not None and rows:
            with contextlib.suppress(OSError):  # it then vouches for less
                self._witness.write(rows[-1].seq, rows[-1].checksum)

    def snapshots(self) -> list[SnapshotRow]:
        """Return the snapshots, newest first."""
        query = "SELECT seq, event_checksum, body, checksum FROM snapshots ORDER BY seq DESC"
        with self._reading():
            return [SnapshotRow(*row) for row in self._db.execute(query)]

    def add_snapshot(self, row: SnapshotRow) -> None:
        """Keep one more snapshot."""
        with self._writing():
            self._db.execute("INSERT OR REPLACE INTO snapshots VALUES (?, ?, ?, ?)", row)

    def forget(self, up_to: int, limit: int) -> int:
        """Remove some of the events up to `up_to`, and the snapshots before it."""
        with self._writing():
            self._db.execute("DELETE FROM snapshots WHERE seq < ?", (up_to,))
            done = self._db.execute(
                "DELETE FROM events WHERE seq IN (SELECT seq FROM events WHERE seq <= ? ORDER BY seq LIMIT ?)",
                (up_to, limit),
            )
            return done.rowcount

    def archive(self, rows: Sequence[ArchivedRow]) -> None:
        """Keep missions that have ended."""
        with self._writing():
            self._db.executemany("INSERT OR REPLACE INTO archive VALUES (?, ?, ?, ?, ?)", rows)

    def archived(self, *, mission_id: str | None = None, idempotency_key: str | None = None) -> bytes | None:
        """Return the body of the mission with this id or key, or None if there is none."""
        query = "SELECT body FROM archive WHERE mission_id = ? OR idempotency_key = ?"
        with self._reading():
            row = self._db.execute(query, (mission_id, idempotency_key)).fetchone()
        return row[0] if row else None

    def archived_newest(self, states: Sequence[MissionStatus], limit: int) -> list[bytes]:
        """Return the bodies of missions in these states, the highest number first."""
        wanted = states or tuple(MissionStatus)
        marks = ", ".join("?" * len(wanted))
        query = f"SELECT body FROM archive WHERE state IN ({marks}) ORDER BY number DESC LIMIT ?"  # noqa: S608
        with self._reading():
            return [row[0] for row in self._db.execute(query, (*wanted, limit))]

    def probe(self) -> None:
        """Find out whether the disk takes writes again."""
        with self._writing():
            # a page's worth, so that the last free bytes of a disk do not pass for room
            self._db.execute("INSERT OR REPLACE INTO about VALUES ('probe', hex(randomblob(4096)))")
        with self._writing():
            self._db.execute("DELETE FROM about WHERE name = 'probe'")

    def hold(self) -> None:
        """Do nothing: the lock on the file lasts as long as the process."""

    def corrupt(self, what: str) -> JournalCorruptError:
        """Return the error for contents that cannot be true."""
        return _corrupt(self._path, what)

    def close(self) -> None:
        """Let another process have it."""
        self._db.close()
        if self._witness is not None:
            self._witness.close()
            self._witness = None
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _witnessed(self) -> Witnessed:
        try:
            return (self._witness and self._witness.read()) or Witnessed(0, 0)
        except ValueError as error:
            raise _lost(self._path, f"the witness beside it is damaged: {error}") from error

    @contextlib.contextmanager
    def _reading(self) -> Generator[None]:
        try:
            yield
        except (sqlite3.Error, TypeError) as error:
            raise _corrupt(self._path, f"it cannot be read ({error})") from error

    @contextlib.contextmanager
    def _writing(self) -> Generator[None]:
        try:
            self._db.execute("BEGIN IMMEDIATE")
            yield
            self._db.execute("COMMIT")
        except sqlite3.Error as error:
            with contextlib.suppress(sqlite3.Error):
                self._db.execute("ROLLBACK")
            raise JournalUnavailableError(f"cannot write {self._path}: {error}") from error


def _prepare(db: sqlite3.Connection, path: Path, site: str) -> None:
    db.execute("PRAGMA journal_mode=WAL")
    db.execute("PRAGMA synchronous=FULL")
    problems = [row[0] for row in db.execute("PRAGMA quick_check")]
    if problems != ["ok"]:
        raise _corrupt(path, problems[0])
    db.execute("BEGIN IMMEDIATE")
    db.execute("CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT")
    db.executemany("INSERT OR IGNORE INTO about VALUES (?, ?)", [("format", FORMAT), ("site", site)])
    about = dict(db.execute("SELECT name, value FROM about"))
    _check_about(about, path, site)
    for statement in _TABLES.split(";"):
        db.execute(statement)
    db.execute("UPDATE about SET value = ? WHERE name = 'format'", (FORMAT,))
    db.execute("COMMIT")


def _check_about(about: dict[str, str], path: Path, site: str) -> None:
    if about.get("format") not in READABLE:
        raise JournalError(f"{path} has format {about.get('format')}; this program reads formats up to {FORMAT}")
    if about.get("site") != site:
        raise JournalError(f"{path} belongs to the site {about.get('site')}, not {site}; use another data directory")


def _corrupt(path: Path, what: str) -> JournalCorruptError:
    return JournalCorruptError(
        f"the journal {path} is damaged: {what}. Nothing was changed. Restore it from a backup, or move it away (with"
        " its -wal, -shm and .witness files) to start empty; stop robots that still work on an old mission by hand then"
    )


def _lost(path: Path, what: str) -> JournalCorruptError:
    return JournalCorruptError(
        f"the journal {path} is not whole: {what}. Nothing was changed. Put back its -wal file or a backup that has all"
        f" events; or, to go on without them, stop every robot, delete {path.with_suffix('.witness')} and start again:"
        " what robots did since then is not known to any mission"
    )
