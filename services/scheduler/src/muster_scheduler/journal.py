"""The append-only journal of events: the scheduler's only truth.

A batch of events is one commit. Each row carries a checksum chained to the one before, so a changed, missing or foreign
row is seen at start-up and never silently skipped. Where the rows lie is the store's business.
"""

import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Self

from pydantic import ValidationError

from .core.events import EVENT, AnyEvent
from .storage.port import (
    EventRow,
    JournalCorruptError,
    JournalError,
    JournalLostError,
    JournalUnavailableError,
    Store,
)
from .storage.sqlite import SqliteStore

__all__ = ["Journal", "JournalCorruptError", "JournalError", "JournalLostError", "JournalUnavailableError"]


class Journal:
    """The events of one site, on a store that this process holds."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._seq = 0
        self._checksum = 0

    @classmethod
    def open(cls, directory: Path, site: str) -> Self:
        """Take the journal of a site in a directory, or begin one (SQLite).

        Raises:
            JournalError: another process has it, it is another site's, or the disk does not allow it.
            JournalCorruptError: SQLite finds it damaged.

        """
        return cls(SqliteStore.open(directory, site))

    def events(self) -> Iterator[AnyEvent]:
        """Yield every event from the first; then new ones can be appended.

        Raises:
            JournalCorruptError: a row is missing, changed, or no event.

        """
        self._seq = self._checksum = 0
        for row in self._store.events(0):
            if row.seq != self._seq + 1:
                raise self.corrupt(f"event {self._seq + 1} is missing")
            self._checksum = zlib.crc32(row.body, self._checksum)
            if row.checksum != self._checksum:
                raise self.corrupt(f"event {row.seq} is not as it was written")
            self._seq = row.seq
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
        for seq, event in enumerate(events, self._seq + 1):
            body = event.to_json()
            checksum = zlib.crc32(body, checksum)
            rows.append(EventRow(seq, body, checksum))
        self._store.append(rows)
        self._seq += len(rows)
        self._checksum = checksum

    def probe(self) -> None:
        """Find out whether the store takes writes again; raises what `append` raises."""
        self._store.probe()

    def corrupt(self, what: str) -> JournalCorruptError:
        """Return the error for a journal that cannot be true."""
        return self._store.corrupt(what)

    def close(self) -> None:
        """Let another process have it."""
        self._store.close()
