"""What the journal needs of a database. One writer at a time, and one thread at a time.

The journal knows what rows mean; a store only keeps them: durably before a call returns, and all of a call or nothing.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

from muster_schemas.mission import MissionStatus


class JournalError(Exception):
    """The journal cannot be used; the message says what to do."""


class JournalCorruptError(JournalError):
    """What is in the journal is not what was written."""


class JournalUnavailableError(JournalError):
    """The database took nothing of a batch, for instance because the disk is full; it may later."""


class JournalLostError(JournalError):
    """The journal is no longer held by this process, which must stop acting at once."""


class EventRow(NamedTuple):
    """One event."""

    seq: int
    """From 1, without gaps."""
    body: bytes
    checksum: int
    """CRC-32 of the body, begun with the checksum of the row before."""


class SnapshotRow(NamedTuple):
    """The whole state after the event `seq`."""

    seq: int
    event_checksum: int
    """Of that event's row, for the chain to go on from."""
    body: bytes
    checksum: int
    """CRC-32 of the body, begun with the two numbers above."""


class ArchivedRow(NamedTuple):
    """A mission that has ended and left the state."""

    mission_id: str
    number: int
    state: MissionStatus
    idempotency_key: str | None
    body: bytes


class Store(Protocol):
    """The rows of one site's journal, held by this process."""

    @property
    def where(self) -> str:
        """The file or database, for people; no secrets."""
        ...

    def events(self, after: int) -> Iterator[EventRow]:
        """Yield the events that follow `after`, in order.

        Raises:
            JournalCorruptError: they cannot be read, or some that were committed are missing at the end.

        """
        ...

    def append(self, rows: Sequence[EventRow]) -> None:
        """Add events.

        Raises:
            JournalUnavailableError: none was added; the caller may try again later.
            JournalLostError: nobody knows whether they were added, and this process may not write any more.

        """
        ...

    def snapshots(self) -> list[SnapshotRow]:
        """Return the snapshots, newest first."""
        ...

    def add_snapshot(self, row: SnapshotRow) -> None:
        """Keep one more snapshot; raises what `append` raises."""
        ...

    def forget(self, up_to: int, limit: int) -> int:
        """Remove events and snapshots that nobody needs any more; raises what `append` raises.

        Args:
            up_to: events up to here, and snapshots before it.
            limit: at most so many events at a time.

        Returns:
            how many events were removed.

        """
        ...

    def archive(self, rows: Sequence[ArchivedRow]) -> None:
        """Keep missions that have ended; one that is there already is replaced. Raises what `append` raises."""
        ...

    def archived(self, *, mission_id: str | None = None, idempotency_key: str | None = None) -> bytes | None:
        """Return the body of the mission with this id or key, or None if there is none."""
        ...

    def archived_newest(self, states: Sequence[MissionStatus], limit: int) -> list[bytes]:
        """Return the bodies of missions in these states (of all, if there are none), the highest number first."""
        ...

    def probe(self) -> None:
        """Find out whether the database takes writes; raises what `append` raises."""
        ...

    def hold(self) -> None:
        """Make sure that this process still holds the journal; to be called every second.

        Raises:
            JournalLostError: it does not.

        """
        ...

    def corrupt(self, what: str) -> JournalCorruptError:
        """Return the error for contents that cannot be true; it says what a person can do."""
        ...

    def close(self) -> None:
        """Let another process have the journal."""
        ...
