"""What a start costs after years of missions: the whole journal, and the same one after it was made small."""

import contextlib
import sqlite3
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from muster_scheduler.compaction import snapshot
from muster_scheduler.core.archive import archivable
from muster_scheduler.core.events import MissionsArchived
from muster_scheduler.journal import Journal
from muster_scheduler.recovery import replay
from muster_scheduler.storage.sqlite import SqliteStore
from muster_scheduler.testing import Yard, planned, yard_file
from muster_schemas.site import load_site

MISSIONS: Final = 2_000
TASKS: Final = 5
_SIZES: Final = ("page_count", "freelist_count", "page_size")
SITE: Final = load_site(yard_file())


def measure() -> list[dict[str, Any]]:
    """Return seconds to the replayed state and megabytes on disk, whole and compacted."""
    yard = Yard(SITE, check=False)
    yard.open()
    names = [f"n{i}" for i in range(TASKS)]
    plan = [planned(n, "Excavation", ["robot_excavator_01"], names[max(i - 1, 0) : i]) for i, n in enumerate(names)]
    for _ in range(MISSIONS):
        yard.run(yard.submit(*plan))
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder)
        journal = Journal.open(directory, SITE.name)
        journal.append(yard.events)
        whole_s, whole_mb = _start(directory, journal)
        journal = Journal.open(directory, SITE.name)
        replay(journal)
        old = archivable(yard.core.state)
        journal.archive(old)
        before = len(yard.events)
        yard.happen(MissionsArchived(at=yard.now, mission_ids=tuple(m.mission_id for m in old)))
        journal.append(yard.events[before:])
        for _ in range(2):
            yard.wait(1.0)
            journal.append(yard.events[-1:])
            reader = SqliteStore.read(directory, SITE.name)
            journal.add_snapshot(snapshot(Journal(reader)))
            reader.close()
        while journal.forget(1_000):
            pass
        small_s, small_mb = _start(directory, journal)
    return [
        _row("journal_events", before, "events", None),
        _row("journal_start_whole_s", whole_s, "s", None),
        _row("journal_start_compacted_s", small_s, "s", None),
        _row("journal_start_compacted_over_whole", small_s / whole_s, "x", 0.2),
        _row("journal_whole_mb", whole_mb, "MB", None),
        _row("journal_compacted_mb", small_mb, "MB", None),
    ]


def _start(directory: Path, journal: Journal) -> tuple[float, float]:
    """Close the journal; return the seconds of a new start, and its megabytes without the free pages in the file."""
    journal.close()
    begun = time.perf_counter()
    journal = Journal.open(directory, SITE.name)
    replay(journal)
    seconds = time.perf_counter() - begun
    journal.close()
    return seconds, _used_bytes(directory / "journal.sqlite") / 1e6


def _used_bytes(path: Path) -> int:
    """Return the bytes of pages in use; SQLite fills freed ones again before the file grows."""
    with contextlib.closing(sqlite3.connect(path)) as db:
        pages, free, size = (db.execute(f"PRAGMA {name}").fetchone()[0] for name in _SIZES)
    return (pages - free) * size


def _row(name: str, value: float, unit: str, bar: float | None) -> dict[str, Any]:
    return {"name": name, "value": round(value, 4), "unit": unit, "bar": bar, "ok": bar is None or value <= bar}


if __name__ == "__main__":
    for row in measure():
        print(row)
