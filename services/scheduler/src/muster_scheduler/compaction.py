"""Makes a snapshot in a process of its own, so that the scheduler stands still for none of it.

`python -m muster_scheduler.compaction` only reads: it replays the journal as the scheduler would at a start and writes
the snapshot to its standard output. The scheduler, the only writer, puts it into the store.
"""

import asyncio
import json
import os
import sys
from collections.abc import Mapping

from muster_bus import logs
from muster_bus.settings import child_environment, read
from muster_schemas.site import load_site

from .core.memory import load
from .journal import Journal, JournalError
from .recovery import replay
from .settings import SchedulerSettings
from .storage.opening import open_for_reading
from .storage.port import SnapshotRow


class CompactionError(Exception):
    """There is no snapshot; the message says why."""


def snapshot(journal: Journal) -> SnapshotRow:
    """Return a snapshot of a journal that nobody has read yet.

    Raises:
        JournalError: the journal cannot be read.
        CompactionError: the snapshot would not be the state that it is made from.

    """
    core = replay(journal)
    row = journal.snapshot_of(core.state)
    if load(journal.begin_at(row)) != core.state:
        raise CompactionError("the state that was read back is not the one that was written")
    return row


async def snapshot_elsewhere(environment: Mapping[str, str]) -> SnapshotRow:
    """Have another process make a snapshot; cancel this to end it.

    Args:
        environment: the MUSTER_ variables that tell it where the journal is.

    Raises:
        CompactionError: it did not work.

    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "muster_scheduler.compaction"),
        env=child_environment(environment),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        out, err = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
    if process.returncode != 0:
        raise CompactionError(f"exit code {process.returncode}: {err.decode(errors='replace')[-1000:]}")
    head, _, body = out.partition(b"\n")
    seq, event_checksum, checksum = json.loads(head)
    return SnapshotRow(seq, event_checksum, body, checksum)


def main() -> None:
    """Write a snapshot to standard output, at low priority."""
    os.nice(10)
    settings = read(SchedulerSettings)
    logs.set_up("warning", service="compaction")
    try:
        row = snapshot(Journal(open_for_reading(settings, load_site(settings.site_file).name)))
    except (JournalError, CompactionError) as error:
        sys.exit(f"compaction: {error}")
    sys.stdout.buffer.write(json.dumps([row.seq, row.event_checksum, row.checksum]).encode() + b"\n" + row.body)


if __name__ == "__main__":
    main()
