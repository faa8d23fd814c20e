"""A journal that was made small tells what the whole one told, wherever the process ended while it was made small."""

import asyncio
import sqlite3
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from muster_scheduler.compaction import CompactionError, snapshot, snapshot_elsewhere
from muster_scheduler.core.archive import archivable
from muster_scheduler.core.events import AnyEvent, MissionsArchived, Tick
from muster_scheduler.core.memory import load
from muster_scheduler.core.state import Mission
from muster_scheduler.core.views import mission_view
from muster_scheduler.journal import Journal, JournalCorruptError
from muster_scheduler.recovery import replay
from muster_scheduler.settings import SchedulerSettings
from muster_scheduler.storage.sqlite import SqliteStore
from muster_scheduler.testing import Yard, planned, yard_file


def busy(yard: Yard, missions: int = 6) -> list[Mission]:
    """Let missions run to their ends, and begin one more."""
    ended = [yard.submit(planned("dig", "Excavation", types=["excavator"], count=2)) for _ in range(missions)]
    for mission in ended:
        yard.run(mission)
    yard.submit(planned("dig", "Excavation", ["robot_excavator_01"]))
    return ended


def as_read(directory: Path) -> SqliteStore:
    """Return the store for reading, as the process that makes snapshots has it."""
    return SqliteStore.read(directory, "yard")


def snapshot_now(directory: Path, journal: Journal) -> None:
    """Make a snapshot and add it."""
    store = as_read(directory)
    journal.add_snapshot(snapshot(Journal(store)))
    store.close()


def steps(directory: Path, yard: Yard) -> Iterator[str]:
    """Do all that housekeeping does, one commit after the other; the journal is closed at each step."""

    def commit(name: str, work: Callable[[Journal], object]) -> str:
        journal = Journal.open(directory, "yard")
        replay(journal)
        work(journal)
        journal.close()
        return name

    def append(journal: Journal, events: list[AnyEvent]) -> None:
        journal.append(events)

    old = archivable(yard.core.state, keep=1)
    yield commit("nothing", Journal.hold)
    yield commit("archive", lambda j: j.archive(old))
    count = len(yard.events)
    yard.happen(MissionsArchived(at=yard.now, mission_ids=tuple(m.mission_id for m in old)))
    yield commit("archived", lambda j: append(j, yard.events[count:]))
    for number in range(3):
        yield commit(f"snapshot {number}", lambda j: snapshot_now(directory, j))
        yield commit(f"forget {number}", lambda j: j.forget(5))
        yield commit(f"forget again {number}", lambda j: j.forget(100_000))
        yard.wait(1.0)
        yield commit(f"tick {number}", lambda j: append(j, yard.events[-1:]))


def test_nothing_is_lost_between_any_two_steps(tmp_path: Path, yard: Yard) -> None:
    """After each of its commits the state is the replay, and each mission that ever was is found as it ended."""
    ended = busy(yard)
    views = {m.mission_id: mission_view(m) for m in ended}
    journal = Journal.open(tmp_path, "yard")
    journal.append(yard.events)
    journal.close()
    sizes: dict[str, int] = {}
    for step in steps(tmp_path, yard):
        journal = Journal.open(tmp_path, "yard")
        state = replay(journal).state
        assert state == yard.core.state, step
        for mission_id, view in views.items():
            mission = state.missions.get(mission_id) or journal.archived(mission_id=mission_id)
            assert mission is not None, step
            assert mission_view(mission) == view, step
        journal.close()
        with sqlite3.connect(tmp_path / "journal.sqlite") as database:
            sizes[step] = database.execute("SELECT count(*) FROM events").fetchone()[0]
        database.close()
    assert sizes["nothing"] < sizes["forget again 0"]  # one snapshot alone lets nothing go
    assert sizes["tick 2"] <= 3


@pytest.fixture
def compacted(tmp_path: Path, yard: Yard) -> Path:
    """Provide a journal with two snapshots and an event after each; the events before the first are gone."""
    busy(yard, 2)
    journal = Journal.open(tmp_path, "yard")
    journal.append(yard.events)
    for _ in range(2):
        snapshot_now(tmp_path, journal)
        yard.wait(1.0)
        journal.append(yard.events[-1:])
    journal.forget(100_000)
    journal.close()
    return tmp_path


def damage(directory: Path, rows: str) -> None:
    """Change one byte in the snapshots that are named."""
    with sqlite3.connect(directory / "journal.sqlite") as database:
        for seq, body in database.execute(f"SELECT seq, body FROM snapshots {rows}").fetchall():  # noqa: S608
            middle = len(body) // 2
            changed = body[:middle] + bytes([body[middle] ^ 1]) + body[middle + 1 :]
            database.execute("UPDATE snapshots SET body = ? WHERE seq = ?", (changed, seq))
    database.close()


def test_a_damaged_snapshot_is_passed_over_for_the_one_before(compacted: Path, yard: Yard) -> None:
    """The events since that one are still there, so nothing is missing."""
    damage(compacted, "ORDER BY seq DESC LIMIT 1")
    journal = Journal.open(compacted, "yard")
    assert replay(journal).state == yard.core.state
    journal.append([Tick(at=yard.now)])
    journal.close()


def test_without_a_whole_snapshot_the_start_is_refused(compacted: Path) -> None:
    """The message names the snapshot and says what to do."""
    damage(compacted, "")
    journal = Journal.open(compacted, "yard")
    with pytest.raises(JournalCorruptError, match=r"the snapshot after event \d+ is of no use.*Restore it"):
        replay(journal)
    journal.close()


def test_a_snapshot_of_another_version_is_passed_over(compacted: Path, yard: Yard) -> None:
    """Its checksum is right, but this program cannot read it."""
    journal = Journal.open(compacted, "yard")
    newest = journal.snapshots()[0]
    foreign = newest._replace(seq=newest.seq + 1, body=b"muster snapshot 99\n" + zlib.compress(b"{}"))
    checksum = zlib.crc32(foreign.body, zlib.crc32(f"{foreign.seq} {foreign.event_checksum}".encode()))
    journal.add_snapshot(foreign._replace(checksum=checksum))
    assert replay(journal).state == yard.core.state
    journal.close()


async def test_another_process_makes_the_same_snapshot(tmp_path: Path, yard: Yard) -> None:
    """While the scheduler holds the journal and goes on writing."""
    busy(yard, 1)
    settings = SchedulerSettings(site_file=yard_file(), data_dir=tmp_path)
    journal = Journal.open(tmp_path / "scheduler", "yard")
    journal.append(yard.events)
    row = await snapshot_elsewhere(settings.environment())
    assert load(journal.begin_at(row)) == yard.core.state
    assert row.seq == len(yard.events)
    journal.close()


async def test_a_snapshot_that_cannot_be_made_says_why(tmp_path: Path) -> None:
    """The scheduler goes on without it."""
    settings = SchedulerSettings(site_file=yard_file(), data_dir=tmp_path)
    with pytest.raises(CompactionError, match="cannot read"):
        await asyncio.wait_for(snapshot_elsewhere(settings.environment()), 240)
