"""The journal in a PostgreSQL database, which one scheduler holds by an advisory lock while others stand by.

The lock belongs to the session, and so does the right to write: whoever loses the connection has lost both at once and
must stop acting. The database itself ends a session that has been silent for `LEASE_S`, which is the lease of a
scheduler that hangs or is cut off. What such a one may still send is refused by the robots: its epoch is over.
"""

import contextlib
from collections.abc import Generator, Iterator, Sequence
from typing import Any, Final, LiteralString, Self

import psycopg
from muster_schemas.mission import MissionStatus
from psycopg.conninfo import conninfo_to_dict, make_conninfo

from .port import (
    ArchivedRow,
    EventRow,
    JournalCorruptError,
    JournalError,
    JournalLostError,
    JournalUnavailableError,
    SnapshotRow,
)

FORMAT: Final = "2"
LEASE_S: Final = 10
"""A session that says nothing for so long is ended; `hold` says something every second."""
GIVE_UP_S: Final = 4
"""A holder that gets no answer for so long gives itself up, well before its lease ends."""
_OLDEST_VERSION: Final = 140000
_TABLES: Final = """
CREATE TABLE IF NOT EXISTS about (name text PRIMARY KEY, value text NOT NULL);
CREATE TABLE IF NOT EXISTS events (seq bigint PRIMARY KEY, body bytea NOT NULL, checksum bigint NOT NULL);
CREATE TABLE IF NOT EXISTS snapshots (
    seq bigint PRIMARY KEY, event_checksum bigint NOT NULL, body bytea NOT NULL, checksum bigint NOT NULL
);
CREATE TABLE IF NOT EXISTS archive (
    mission_id text PRIMARY KEY, number bigint NOT NULL, state text NOT NULL, idempotency_key text, body bytea NOT NULL
);
CREATE INDEX IF NOT EXISTS archive_numbers ON archive (number);
CREATE INDEX IF NOT EXISTS archive_keys ON archive (idempotency_key) WHERE idempotency_key IS NOT NULL;
"""
_LOCK: Final = 0x6D7573746572
"""The key of the advisory lock; keys are of one database."""
_CONNECTION: Final = {
    "application_name": "muster-scheduler",
    "connect_timeout": "5",
    "keepalives_idle": "2",
    "keepalives_interval": "1",
    "keepalives_count": "2",
    "tcp_user_timeout": str(GIVE_UP_S * 1000),
}


class PostgresStore:
    """One session with the database of a site. It may only read until `try_lock` has said yes."""

    def __init__(self, connection: psycopg.Connection[Any], site: str) -> None:
        self._db = connection
        self._site = site
        self.where = f"database {connection.info.dbname} on {connection.info.host or 'localhost'}"

    @classmethod
    def connect(cls, url: str, site: str) -> Self:
        """Begin a session.

        Raises:
            JournalUnavailableError: the database does not let us in now.
            JournalError: it cannot be used.

        """
        try:
            given = conninfo_to_dict(url)
            wanted = make_conninfo(url, **{k: v for k, v in _CONNECTION.items() if k not in given})
            connection = psycopg.connect(wanted, autocommit=True)
        except psycopg.Error as error:
            raise JournalUnavailableError(f"cannot reach the database of MUSTER_DATABASE_URL: {error}") from error
        with contextlib.ExitStack() as undo:
            undo.callback(connection.close)
            store = cls(connection, site)
            store._check_server()
            undo.pop_all()
        return store

    @classmethod
    def read(cls, url: str, site: str) -> Self:
        """Return the journal of a site, which another process may hold, for reading only.

        Raises:
            JournalError: there is none, or it is another site's.

        """
        with contextlib.ExitStack() as undo:
            store = cls.connect(url, site)
            undo.callback(store.close)
            store._check_about()
            undo.pop_all()
        return store

    def try_lock(self) -> bool:
        """Return whether this session now holds the journal; then its tables are there and it is this site's.

        Raises:
            JournalLostError: the session has ended.
            JournalError: the journal is another site's or another program's.

        """
        with self._talking():
            if not self._one("SELECT pg_try_advisory_lock(%s)", (_LOCK,)):
                return False
            with self._db.transaction():
                self._db.execute(_TABLES)
                for name, value in (("format", FORMAT), ("site", self._site)):
                    self._db.execute("INSERT INTO about VALUES (%s, %s) ON CONFLICT DO NOTHING", (name, value))
        self._check_about()
        return True

    def holder(self) -> str:
        """Return who holds the journal, for people; raises JournalLostError."""
        query = (
            "SELECT coalesce(host(client_addr), 'the machine of the database'), backend_start"
            " FROM pg_stat_activity JOIN pg_locks USING (pid)"
            " WHERE locktype = 'advisory' AND granted AND datname = current_database() AND datid = database LIMIT 1"
        )
        with self._talking():
            found = self._db.execute(query).fetchone()
        return f"a scheduler on {found[0]}, connected since {found[1]:%Y-%m-%d %H:%M:%S}" if found else "nobody now"

    def _check_about(self) -> None:
        try:
            about = dict(self._db.execute("SELECT name, value FROM about").fetchall())
        except psycopg.Error as error:
            raise JournalError(f"cannot read the journal in the {self.where}: {error}") from error
        if about.get("format") != FORMAT:
            raise JournalError(f"{self.where} has format {about.get('format')}; this program reads format {FORMAT}")
        if about.get("site") != self._site:
            raise JournalError(
                f"{self.where} belongs to the site {about.get('site')}, not {self._site}; use another database"
            )

    def events(self, after: int) -> Iterator[EventRow]:
        """Yield the events that follow `after`, in order."""
        query = "SELECT seq, body, checksum FROM events WHERE seq > %s ORDER BY seq"
        with self._talking(), self._db.transaction(), self._db.cursor(name="events") as cursor:
            cursor.itersize = 5000
            for row in cursor.execute(query, (after,)):
                yield EventRow(*row)

    def append(self, rows: Sequence[EventRow]) -> None:
        """Add events by one statement."""
        self._write(
            "INSERT INTO events SELECT * FROM unnest(%s::bigint[], %s::bytea[], %s::bigint[])",
            ([r.seq for r in rows], [r.body for r in rows], [r.checksum for r in rows]),
        )

    def snapshots(self) -> list[SnapshotRow]:
        """Return the snapshots, newest first."""
        with self._talking():
            query = "SELECT seq, event_checksum, body, checksum FROM snapshots ORDER BY seq DESC"
            return [SnapshotRow(*row) for row in self._db.execute(query)]

    def add_snapshot(self, row: SnapshotRow) -> None:
        """Keep one more snapshot."""
        self._write("INSERT INTO snapshots VALUES (%s, %s, %s, %s) ON CONFLICT DO NOTHING", row)

    def forget(self, up_to: int, limit: int) -> int:
        """Remove some of the events up to `up_to`, and the snapshots before it."""
        self._write("DELETE FROM snapshots WHERE seq < %s", (up_to,))
        return self._write(
            "DELETE FROM events WHERE seq IN (SELECT seq FROM events WHERE seq <= %s ORDER BY seq LIMIT %s)",
            (up_to, limit),
        )

    def archive(self, rows: Sequence[ArchivedRow]) -> None:
        """Keep missions that have ended."""
        columns = [list(column) for column in zip(*rows, strict=True)]
        self._write(
            "INSERT INTO archive SELECT * FROM unnest(%s::text[], %s::bigint[], %s::text[], %s::text[], %s::bytea[])"
            " ON CONFLICT (mission_id) DO UPDATE SET number = excluded.number, state = excluded.state,"
            " idempotency_key = excluded.idempotency_key, body = excluded.body",
            columns,
        )

    def archived(self, *, mission_id: str | None = None, idempotency_key: str | None = None) -> bytes | None:
        """Return the body of the mission with this id or key, or None if there is none."""
        query = "SELECT body FROM archive WHERE mission_id = %s OR idempotency_key = %s"
        with self._talking():
            return self._one(query, (mission_id, idempotency_key))

    def archived_newest(self, states: Sequence[MissionStatus], limit: int) -> list[bytes]:
        """Return the bodies of missions in these states, the highest number first."""
        query = "SELECT body FROM archive WHERE state = ANY(%s) ORDER BY number DESC LIMIT %s"
        wanted = [str(state) for state in states or MissionStatus]
        with self._talking():
            return [row[0] for row in self._db.execute(query, (wanted, limit))]

    def probe(self) -> None:
        """Find out whether the database takes writes."""
        self._write("INSERT INTO about VALUES ('probe', repeat('x', 4096)) ON CONFLICT DO NOTHING", ())
        self._write("DELETE FROM about WHERE name = 'probe'", ())

    def hold(self) -> None:
        """Say something, so that the lease goes on, and find out whether it does."""
        with self._talking():
            self._db.execute("SELECT set_config('idle_session_timeout', %s, false)", (f"{LEASE_S}s",))

    def corrupt(self, what: str) -> JournalCorruptError:
        """Return the error for contents that cannot be true."""
        return JournalCorruptError(
            f"the journal in the {self.where} is damaged: {what}. Nothing was changed. Restore it from a backup, or use"
            " an empty database; stop robots that still work on an old mission by hand then"
        )

    def close(self) -> None:
        """End the session, and with it the lock."""
        self._db.close()

    def _check_server(self) -> None:
        """Refuse a server that may forget what it has committed."""
        if self._db.info.server_version < _OLDEST_VERSION:
            raise JournalError(f"{self.where} is older than PostgreSQL 14")
        if self._one("SELECT current_setting('fsync')") != "on":
            raise JournalError(f"{self.where} runs with fsync=off: it would lose missions; turn it on")
        if self._one("SELECT current_setting('synchronous_commit')") in ("off", "local"):
            self._db.execute("SET synchronous_commit = on")

    def _one(self, query: LiteralString, values: Sequence[Any] = ()) -> Any:
        row = self._db.execute(query, values).fetchone()
        return row[0] if row else None

    def _write(self, query: LiteralString, values: Sequence[Any]) -> int:
        with self._talking():
            try:
                return self._db.execute(query, values).rowcount
            except psycopg.IntegrityError as error:
                raise JournalLostError(f"somebody else wrote into the {self.where}: {error}") from error
            except psycopg.Error as error:
                if self._db.broken or self._db.closed:
                    raise
                raise JournalUnavailableError(f"cannot write into the {self.where}: {error}") from error

    @contextlib.contextmanager
    def _talking(self) -> Generator[None]:
        try:
            yield
        except psycopg.Error as error:
            raise JournalLostError(f"lost the {self.where}, and with it the journal: {error}") from error
