"""What the journal asks of a store holds for each of them, on the real databases."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from muster_scheduler.storage.port import ArchivedRow, EventRow, JournalError, SnapshotRow, Store
from muster_scheduler.storage.postgres import PostgresStore
from muster_scheduler.storage.sqlite import SqliteStore
from muster_scheduler.testing_postgres import PostgresServer
from muster_schemas.mission import MissionStatus

ROWS = [EventRow(n, b'{"n": %d}' % n, 7 * n) for n in range(1, 10)]
SUCCEEDED, FAILED = MissionStatus.SUCCEEDED, MissionStatus.FAILED
Open = Callable[..., Store]


@pytest.fixture(params=["sqlite", "postgresql"])
def opened(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Open]:
    """Provide what takes the same journal again and again, after the one before was closed."""
    stores: list[Store] = []
    url = request.getfixturevalue("postgres").database() if request.param == "postgresql" else ""

    def take(site: str = "yard") -> Store:
        if not url:
            stores.append(SqliteStore.open(tmp_path, site))
        else:
            store = PostgresStore.connect(url, site)
            stores.append(store)
            assert store.try_lock()
        return stores[-1]

    yield take
    for store in stores:
        store.close()


def archived(number: int, state: MissionStatus = SUCCEEDED, key: str | None = None) -> ArchivedRow:
    """Return a row of the archive."""
    return ArchivedRow(f"m{number}", number, state, key, b"mission %d" % number)


def test_events_are_there_in_their_order_for_the_next_life(opened: Open) -> None:
    """What was appended is read back, from any event on."""
    store = opened()
    store.append(ROWS[:4])
    store.append(ROWS[4:])
    assert list(store.events(0)) == ROWS
    store.close()
    store = opened()
    assert list(store.events(0)) == ROWS
    assert list(store.events(6)) == ROWS[6:]


def test_of_a_batch_that_cannot_be_written_nothing_is(opened: Open) -> None:
    """One row that is there already spoils all of the call."""
    store = opened()
    store.append(ROWS[:3])
    with pytest.raises(JournalError):
        store.append(ROWS[2:6])
    assert list(store.events(0)) == ROWS[:3]


def test_snapshots_come_newest_first_and_let_older_events_go(opened: Open) -> None:
    """Events and snapshots before the one that is kept are removed, some at a time."""
    store = opened()
    store.append(ROWS)
    rows = [SnapshotRow(n, 7 * n, b"state %d" % n, n) for n in (2, 5, 8)]
    for row in rows:
        store.add_snapshot(row)
    store.add_snapshot(rows[-1])
    assert store.snapshots() == rows[::-1]
    assert [store.forget(5, 3), store.forget(5, 3), store.forget(5, 3)] == [3, 2, 0]
    assert store.snapshots() == rows[:0:-1]
    assert list(store.events(5)) == ROWS[5:]
    assert [row.seq for row in store.events(0)] == [6, 7, 8, 9]


def test_archived_missions_are_found_by_id_by_key_and_in_lists(opened: Open) -> None:
    """Archiving one again replaces it."""
    store = opened()
    store.archive([archived(1, FAILED, "k1"), archived(3), archived(2, key="k2")])
    store.archive([archived(1, key="k1")])
    assert store.archived(mission_id="m3") == b"mission 3"
    assert store.archived(idempotency_key="k2") == b"mission 2"
    assert store.archived(mission_id="m4") is None
    assert store.archived(idempotency_key="k3") is None
    assert store.archived_newest((), 2) == [b"mission 3", b"mission 2"]
    assert store.archived_newest((SUCCEEDED,), 9) == [b"mission 3", b"mission 2", b"mission 1"]
    assert store.archived_newest((FAILED,), 9) == []


def test_the_journal_of_another_site_is_refused(opened: Open) -> None:
    """Robots of one site must not get another's missions."""
    opened().close()
    with pytest.raises(JournalError, match="belongs to the site yard"):
        opened("quarry")


def test_a_store_that_takes_writes_says_so(opened: Open) -> None:
    """Neither the probe nor holding the journal leaves anything behind."""
    store = opened()
    store.probe()
    store.hold()
    assert list(store.events(0)) == []
    assert store.snapshots() == []


def test_a_reader_sees_what_the_holder_has_committed(postgres: PostgresServer, tmp_path: Path) -> None:
    """A snapshot is made by a process that holds nothing, while the holder goes on."""
    url = postgres.database()
    held = PostgresStore.connect(url, "yard")
    assert held.try_lock()
    for holder, read in (
        (SqliteStore.open(tmp_path, "yard"), lambda: SqliteStore.read(tmp_path, "yard")),
        (held, lambda: PostgresStore.read(url, "yard")),
    ):
        holder.append(ROWS[:5])
        reader = read()
        assert list(reader.events(0)) == ROWS[:5]
        holder.append(ROWS[5:])
        assert list(reader.events(0)) == ROWS
        reader.close()
        holder.close()


def test_there_is_nothing_to_read_before_there_is_a_journal(postgres: PostgresServer, tmp_path: Path) -> None:
    """The error says so, and nothing is made."""
    with pytest.raises(JournalError, match="cannot read"):
        SqliteStore.read(tmp_path, "yard")
    with pytest.raises(JournalError, match="cannot read"):
        PostgresStore.read(postgres.database(), "yard")
    assert list(tmp_path.iterdir()) == []
