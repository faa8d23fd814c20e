"""The append-only journal of events: the scheduler's only truth.

A batch of events is one commit. Each row carries a checksum chained to the one before, so a changed, missing or foreign
row is seen at start-up and never silently skipped. A snapshot stands for all events up to its own; missions that ended
long ago are in the archive. Where the rows lie is the store's business.
"""

import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, Self

from muster_schemas.mission import MissionStatus
from pydantic import ValidationError

from .core.events import EVENT, AnyEvent
from .core.memory import dump, dump_mission, load_mission
from .core.state import Mission, State
from .storage.port import (
    ArchivedRow,
    EventRow,
    JournalCorruptError,
    JournalError,
    JournalLostError,
    JournalUnavailableError,
    SnapshotRow,
    Store,
)
from .storage.sqlite import SqliteStore

__all__ = ["Journal", "JournalCorruptError", "JournalError", "JournalLostError", "JournalUnavailableError"]

SNAPSHOT_FORMAT: Final = b"muster snapshot 1\n"
SNAPSHOTS_KEPT: Final = 2
"""The newest, and the one before in case it is damaged; events since that one are kept."""


class Journal:
    """The events of one site, on a store that this process holds."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self.seq = 0
        """Of the last event."""
        self._checksum = 0
        self._snapshot_seqs: list[int] = []

    @classmethod
    def open(cls, directory: Path, site: str) -> Self:
        """Take the journal of a site in a directory, or begin one (SQLite).

        Raises:
            JournalError: another process has it, it is another site's, or the disk does not allow it.
            JournalCorruptError: SQLite finds it damaged.

        """
        return cls(SqliteStore.open(directory, site))

    def begin(self) -> None:
        """Have `events` yield from the first."""
        self.seq = self._checksum = 0

    def begin_at(self, snapshot: SnapshotRow) -> bytes:
        """Have `events` yield those after a snapshot, and return the state in it.

        Raises:
            JournalCorruptError: the snapshot is not as it was written, or of another version of this program.

        """
        if snapshot.checksum != _checksum(snapshot) or not snapshot.body.startswith(SNAPSHOT_FORMAT):
            raise self.corrupt(f"the snapshot after event {snapshot.seq} is not as it was written")
        self.seq, self._checksum = snapshot.seq, snapshot.event_checksum
        return zlib.decompress(snapshot.body[len(SNAPSHOT_FORMAT) :])

    def events(self) -> Iterator[AnyEvent]:
        """Yield every event that follows; then new ones can be appended.

        Raises:
            JournalCorruptError: a row is missing, changed, or no event.

        """
        for row in self._store.events(self.seq):
            if row.seq != self.seq + 1:
                raise self.corrupt(f"event {self.seq + 1} is missing")
            self._checksum = zlib.crc32(row.body, self._checksum)
            if row.checksum != self._checksum:
                raise self.corrupt(f"event {row.seq} is not as it was written")
            self.seq = row.seq
            try:
                event = EVENT.validate_json(row.body)
            except ValidationError as error:
                raise self.corrupt(f"event {row.seq} cannot be read ({error})") from error
            yield event

    def append(self, events: Sequence[AnyEvent]) -> None:
        """Write all of the events, or none.

        Raises:
            JournalUnavailableError: none was written, for instance because the disk is full.
            JournalLostError: another process has taken the journal; this one must stop at once.

        """
        rows: list[EventRow] = []
        checksum = self._checksum
        for seq, event in enumerate(events, self.seq + 1):
            body = event.to_json()
            checksum = zlib.crc32(body, checksum)
            rows.append(EventRow(seq, body, checksum))
        self._store.append(rows)
        self.seq += len(rows)
        self._checksum = checksum

    def snapshots(self) -> list[SnapshotRow]:
        """Return the snapshots, newest first."""
        rows = self._store.snapshots()
        self._snapshot_seqs = [row.seq for row in rows]
        return rows

    def snapshot_of(self, state: State) -> SnapshotRow:
        """Return the snapshot of the state that all events so far have made."""
        body = SNAPSHOT_FORMAT + zlib.compress(dump(state), 1)
        row = SnapshotRow(self.seq, self._checksum, body, 0)
        return row._replace(checksum=_checksum(row))

    def add_snapshot(self, row: SnapshotRow) -> None:
        """Keep a snapshot; raises what `append` raises."""
        self._store.add_snapshot(row)
        self._snapshot_seqs = sorted({row.seq, *self._snapshot_seqs}, reverse=True)

    @property
    def since_snapshot(self) -> int:
        """How many events would be replayed after the newest snapshot."""
        return self.seq - max(self._snapshot_seqs, default=0)

    def forget(self, limit: int) -> int:
        """Remove up to `limit` events that kept snapshots stand for; return how many. Raises what `append` raises."""
        if len(self._snapshot_seqs) < SNAPSHOTS_KEPT:
            return 0
        oldest = self._snapshot_seqs[SNAPSHOTS_KEPT - 1]
        forgotten = self._store.forget(oldest, limit)
        self._snapshot_seqs = self._snapshot_seqs[:SNAPSHOTS_KEPT]
        return forgotten

    def archive(self, missions: Sequence[Mission]) -> None:
        """Keep missions that are about to leave the state; raises what `append` raises."""
        self._store.archive(
            [
                ArchivedRow(m.mission_id, m.number, m.state, m.idempotency_key, zlib.compress(dump_mission(m)))
                for m in missions
            ]
        )

    def archived(self, *, mission_id: str | None = None, idempotency_key: str | None = None) -> Mission | None:
        """Return a mission that has left the state, by its id or key, or None.

        Raises:
            JournalCorruptError: it cannot be read.

        """
        body = self._store.archived(mission_id=mission_id, idempotency_key=idempotency_key)
        return self._mission(body) if body is not None else None

    def archived_newest(self, states: Sequence[MissionStatus], limit: int) -> list[Mission]:
        """Return missions in these states (any, if there are none) that have left the state, newest first.

        Raises:
            JournalCorruptError: one of them cannot be read.

        """
        return [self._mission(body) for body in self._store.archived_newest(states, limit)]

    def _mission(self, body: bytes) -> Mission:
        try:
            return load_mission(zlib.decompress(body))
        except (zlib.error, ValueError) as error:
            raise self.corrupt(f"a mission in the archive cannot be read ({error})") from error

    def probe(self) -> None:
        """Find out whether the store takes writes again; raises what `append` raises."""
        self._store.probe()

    def hold(self) -> None:
        """Make sure that this process still holds the journal; to be called every second.

        Raises:
            JournalLostError: it does not.

        """
        self._store.hold()

    def corrupt(self, what: str) -> JournalCorruptError:
        """Return the error for a journal that cannot be true."""
        return self._store.corrupt(what)

    def close(self) -> None:
        """Let another process have it."""
        self._store.close()


def _checksum(row: SnapshotRow) -> int:
    return zlib.crc32(row.body, zlib.crc32(f"{row.seq} {row.event_checksum}".encode()))
