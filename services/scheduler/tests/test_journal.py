"""The journal: what is in it counts, and what is not right with it is said."""

import resource
import sqlite3
from pathlib import Path

import pytest
from muster_scheduler.core.events import AnyEvent, RobotOffline, SelectorBound, Started, Tick
from muster_scheduler.journal import Journal, JournalCorruptError, JournalError, JournalUnavailableError
from muster_scheduler.recovery import replay
from muster_scheduler.testing import Yard, planned

EVENTS: list[AnyEvent] = [
    Started(at=1.5, epoch=1),
    RobotOffline(at=2.25, robot_id="r1", reason="é"),
    Tick(at=3.0),
]


def written(directory: Path, events: list[AnyEvent]) -> Path:
    """Write events and return the database."""
    journal = Journal.open(directory, "yard")
    list(journal.events())
    journal.append(events)
    journal.close()
    return directory / "journal.sqlite"


def test_events_come_back_as_they_were(tmp_path: Path) -> None:
    """In their order, over several lives of the process."""
    written(tmp_path, EVENTS[:2])
    written(tmp_path, EVENTS[2:])
    journal = Journal.open(tmp_path, "yard")
    assert list(journal.events()) == EVENTS
    journal.close()


def test_the_replayed_core_is_the_one_that_lived(tmp_path: Path, yard: Yard) -> None:
    """Everything that the core knows is in the journal."""
    yard.run(yard.submit(planned("dig", "Excavation", types=["excavator"], count=2)))
    written(tmp_path, yard.events)
    journal = Journal.open(tmp_path, "yard")
    assert replay(journal).state == yard.core.state
    journal.close()


def test_a_second_writer_is_refused(tmp_path: Path) -> None:
    """While one process holds the journal another one cannot open it."""
    first = Journal.open(tmp_path, "yard")
    with pytest.raises(JournalError, match="another scheduler"):
        Journal.open(tmp_path, "yard")
    first.close()
    Journal.open(tmp_path, "yard").close()


def test_another_sites_journal_is_refused(tmp_path: Path) -> None:
    """Robots of one site must not get another's missions."""
    written(tmp_path, EVENTS)
    with pytest.raises(JournalError, match="belongs to the site yard"):
        Journal.open(tmp_path, "quarry")


@pytest.mark.parametrize(
    "damage",
    [
        "UPDATE events SET body = CAST(replace(CAST(body AS TEXT), '2.25', '2.26') AS BLOB) WHERE seq = 2",
        "DELETE FROM events WHERE seq = 2",
        "DELETE FROM events WHERE seq = 1",
        "UPDATE events SET checksum = checksum + 1 WHERE seq = 3",
    ],
)
def test_a_changed_journal_is_noticed(tmp_path: Path, damage: str) -> None:
    """A row that was changed or taken out stops the start."""
    path = written(tmp_path, EVENTS)
    with sqlite3.connect(path) as db:
        db.execute(damage)
    db.close()
    journal = Journal.open(tmp_path, "yard")
    with pytest.raises(JournalCorruptError, match=r"damaged.*Restore it"):
        list(journal.events())
    journal.close()


def test_overwritten_bytes_are_noticed_wherever_they_are(tmp_path: Path) -> None:
    """No page of the file can be overwritten without the start noticing, or nothing of the events changing."""
    path = written(tmp_path, [*EVENTS, *[Tick(at=float(i)) for i in range(4, 300)]])
    whole = path.read_bytes()
    expected = 299
    noticed = 0
    for start in range(0, len(whole), 4096):
        path.write_bytes(whole[:start] + b"\xa5" * 64 + whole[start + 64 :])
        try:
            journal = Journal.open(tmp_path, "yard")
        except JournalCorruptError:
            noticed += 1
            continue
        try:
            assert len(list(journal.events())) == expected
        except JournalCorruptError:
            noticed += 1
        finally:
            journal.close()
    assert noticed >= 2


def test_a_batch_that_the_disk_does_not_take_leaves_nothing(tmp_path: Path) -> None:
    """All of a batch or none of it; and the next one can be written when there is room again."""
    journal = Journal.open(tmp_path, "yard")
    list(journal.events())
    journal.append(EVENTS[:1])
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64 * 1024, limits[1]))  # what a full disk says, too
    try:
        with pytest.raises(JournalUnavailableError):
            journal.append([RobotOffline(at=4, robot_id="r1", reason="x" * 200)] * 500)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    journal.probe()
    journal.append(EVENTS[1:])
    journal.begin()
    assert list(journal.events()) == EVENTS
    journal.close()


def test_a_journal_that_tells_what_cannot_have_happened_is_refused(tmp_path: Path) -> None:
    """Well-formed events in an impossible order are damage, too."""
    written(tmp_path, [Started(at=1, epoch=1), SelectorBound(at=2, mission_id="m1", selector="x", robots=("r1",))])
    journal = Journal.open(tmp_path, "yard")
    with pytest.raises(JournalCorruptError, match="cannot have happened"):
        replay(journal)
    journal.close()
