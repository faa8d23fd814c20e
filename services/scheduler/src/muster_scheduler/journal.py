"""The append-only journal of events in SQLite: the scheduler's only truth.

A batch of events is one transaction with one fsync (`synchronous=FULL`). Each row carries a checksum chained to the one
before, so a changed, missing or foreign row is seen at start-up and never silently skipped.
"""

import contextlib
import fcntl
import os
import sqlite3
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, Self

from pydantic import ValidationError

from .core.events import EVENT, AnyEvent

FORMAT: Final = "1"


class JournalError(Exception):
    """The journal cannot be used; the message says what to do."""


class JournalCorruptError(JournalError):
    """What is in the journal is not what was written."""


class JournalUnavailableError(JournalError):
    """The disk took nothing of a batch."""


class Journal:
    """One writer's hold on the journal of one site. Close it, or leave it to the end of the process."""

    def __init__(self, connection: sqlite3.Connection, lock: int, path: Path) -> None:
        self._db = connection
        self._lock = lock
        self._path = path
        self._seq = 0
        self._checksum = 0

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
        connection: sqlite3.Connection | None = None
        try:
            connection = sqlite3.connect(path, isolation_level=None)
            _prepare(connection, path, site)
        except JournalError:
            _give_back(connection, lock)
            raise
        except sqlite3.Error as error:
            _give_back(connection, lock)
            raise _corrupt(path, str(error)) from error
        return cls(connection, lock, path)

    def events(self) -> Iterator[AnyEvent]:
        """Yield every event from the first; then new ones can be appended.

        Raises:
            JournalCorruptError: a row is missing, changed, or no event.

        """
        self._seq = self._checksum = 0
        try:
            for seq, body, checksum in self._db.execute("SELECT seq, body, checksum FROM events ORDER BY seq"):
                if seq != self._seq + 1:
                    raise _corrupt(self._path, f"event {self._seq + 1} is missing")
                self._checksum = zlib.crc32(body, self._checksum)
                if checksum != self._checksum:
                    raise _corrupt(self._path, f"event {seq} is not as it was written")
                self._seq = seq
                yield EVENT.validate_json(body)
        except (sqlite3.Error, ValidationError, TypeError) as error:
            raise _corrupt(self._path, f"event {self._seq} cannot be read ({error})") from error

    def append(self, events: Sequence[AnyEvent]) -> None:
        """Write all of the events, or none.

        Raises:
            JournalUnavailableError: none was written, for instance because the disk is full.

        """
        rows: list[tuple[int, bytes, int]] = []
        checksum = self._checksum
        for seq, event in enumerate(events, self._seq + 1):
            body = event.to_json()
            checksum = zlib.crc32(body, checksum)
            rows.append((seq, body, checksum))
        try:
            self._db.execute("BEGIN IMMEDIATE")
            self._db.executemany("INSERT INTO events (seq, body, checksum) VALUES (?, ?, ?)", rows)
            self._db.execute("COMMIT")
        except sqlite3.Error as error:
            with contextlib.suppress(sqlite3.Error):
                self._db.execute("ROLLBACK")
            raise JournalUnavailableError(f"cannot write {self._path}: {error}") from error
        self._seq += len(rows)
        self._checksum = checksum

    def probe(self) -> None:
        """Find out whether the disk takes writes again.

        Raises:
            JournalUnavailableError: it does not.

        """
        try:
            # a page's worth, so that the last free bytes of a disk do not pass for room
            self._db.execute("INSERT OR REPLACE INTO about VALUES ('probe', hex(randomblob(4096)))")
            self._db.execute("DELETE FROM about WHERE name = 'probe'")
        except sqlite3.Error as error:
            raise JournalUnavailableError(f"cannot write {self._path}: {error}") from error

    def corrupt(self, what: str) -> JournalCorruptError:
        """Return the error for a journal that cannot be true."""
        return _corrupt(self._path, what)

    def close(self) -> None:
        """Let another process have it."""
        _give_back(self._db, self._lock)


def _prepare(db: sqlite3.Connection, path: Path, site: str) -> None:
    db.execute("PRAGMA journal_mode=WAL")
    db.execute("PRAGMA synchronous=FULL")
    problems = [row[0] for row in db.execute("PRAGMA quick_check")]
    if problems != ["ok"]:
        raise _corrupt(path, problems[0])
    db.execute("BEGIN IMMEDIATE")
    db.execute("CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT")
    db.execute(
        "CREATE TABLE IF NOT EXISTS events"
        " (seq INTEGER PRIMARY KEY, body BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT"
    )
    db.executemany("INSERT OR IGNORE INTO about VALUES (?, ?)", [("format", FORMAT), ("site", site)])
    about = dict(db.execute("SELECT name, value FROM about"))
    db.execute("COMMIT")
    if about["format"] != FORMAT:
        raise JournalError(f"{path} has format {about['format']}; this program reads format {FORMAT}")
    if about["site"] != site:
        raise JournalError(f"{path} belongs to the site {about['site']}, not {site}; use another data directory")


def _corrupt(path: Path, what: str) -> JournalCorruptError:
    return JournalCorruptError(
        f"the journal {path} is damaged: {what}. Nothing was changed. Restore it from a backup, or move it away (with"
        " its -wal and -shm files) to start empty; stop robots that still work on an old mission by hand then"
    )


def _give_back(connection: sqlite3.Connection | None, lock: int) -> None:
    if connection is not None:
        connection.close()
    os.close(lock)
