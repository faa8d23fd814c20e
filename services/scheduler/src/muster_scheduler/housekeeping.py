"""Keeps the journal small and held while the scheduler works: archive, snapshot, forget; a little every second.

Each step is one commit, and what it removes is in the store already in another form, so a crash between any two of
them loses nothing.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

import structlog
from muster_bus import crash

from .compaction import CompactionError
from .core.archive import KEPT_ENDED, archivable
from .core.events import MissionsArchived
from .engine import Engine, Wish
from .journal import Journal, JournalUnavailableError
from .storage.port import SnapshotRow

SNAPSHOT_EVENTS: Final = 10_000
"""A snapshot is due after so many events, or twice the number of tasks in the state if that is more."""
ARCHIVE_AT_ONCE: Final = 50
FORGET_AT_ONCE: Final = 1_000
"""Events removed by one commit, so that none delays the scheduler's own."""
PERIOD_S: Final = 1.0

MakeSnapshot = Callable[[], Awaitable[SnapshotRow]]

_log = structlog.stdlib.get_logger(__name__)


class Housekeeping:
    """Runs beside the engine, in the same event loop and so never at the same time as one of its turns."""

    def __init__(
        self,
        engine: Engine,
        journal: Journal,
        make_snapshot: MakeSnapshot,
        *,
        snapshot_events: int = SNAPSHOT_EVENTS,
    ) -> None:
        self._engine = engine
        self._journal = journal
        self._make_snapshot = make_snapshot
        self._snapshot_events = snapshot_events
        self._not_before = 0

    async def run(self) -> None:
        """Work until cancelled.

        Raises:
            JournalLostError: another process has taken the journal: stop at once.

        """
        async with asyncio.TaskGroup() as group:
            group.create_task(self._hold(), name="hold the journal")
            while True:
                await asyncio.sleep(PERIOD_S)
                try:
                    self.archive()
                    self._journal.forget(FORGET_AT_ONCE)
                    await self.snapshot_if_due()
                except JournalUnavailableError as error:
                    _log.warning("housekeeping_postponed", error=str(error))

    async def _hold(self) -> None:
        while True:
            await asyncio.sleep(PERIOD_S)
            self._journal.hold()

    def archive(self) -> None:
        """Have the missions that ended longest ago leave the state; raises JournalUnavailableError."""
        ended = sum(len(ids) for s, ids in self._engine.core.state.by_state.items() if s.ended)
        if ended < KEPT_ENDED + ARCHIVE_AT_ONCE:
            return
        old = archivable(self._engine.core.state)[:ARCHIVE_AT_ONCE]
        if not old:
            return
        self._journal.archive(old)
        crash.point("archived")
        wish = Wish(MissionsArchived(at=self._engine.now(), mission_ids=tuple(m.mission_id for m in old)))
        self._engine.step([wish])

    async def snapshot_if_due(self) -> None:
        """Add a snapshot if there is much to replay since the last one; raises JournalUnavailableError."""
        tasks = sum(len(m.tasks) for m in self._engine.core.state.missions.values())
        due = self._journal.since_snapshot >= max(self._snapshot_events, 2 * tasks)
        if not due or self._journal.seq < self._not_before:
            return
        try:
            row = await self._make_snapshot()
        except CompactionError as error:
            self._not_before = self._journal.seq + self._snapshot_events
            _log.error("snapshot_failed", error=str(error))
            return
        self._journal.add_snapshot(row)
        crash.point("snapshot")
        _log.info("snapshot", after_event=row.seq, bytes=len(row.body), tasks=tasks)
