"""The lock on a journal in PostgreSQL: one holds it, others stand by, and whoever loses it knows."""

import psycopg
import pytest
from muster_scheduler.storage.port import EventRow, JournalLostError, JournalUnavailableError
from muster_scheduler.storage.postgres import PostgresStore
from muster_scheduler.testing_postgres import PostgresServer

ROW = EventRow(1, b"{}", 1)


def test_only_one_holds_the_journal_and_the_next_gets_it_when_that_one_ends(postgres: PostgresServer) -> None:
    """The one that waits can say who has it."""
    url = postgres.database()
    active, standby = PostgresStore.connect(url, "yard"), PostgresStore.connect(url, "yard")
    assert active.try_lock()
    assert not standby.try_lock()
    assert "a scheduler on" in standby.holder()
    active.close()
    assert standby.try_lock()
    standby.close()


@pytest.mark.parametrize("act", ["append", "hold", "probe", "snapshots"])
def test_whoever_loses_its_session_has_lost_the_journal(postgres: PostgresServer, act: str) -> None:
    """It learns so with the next thing it does, and what it then wanted to write is not written."""
    url = postgres.database()
    store = PostgresStore.connect(url, "yard")
    assert store.try_lock()
    postgres.end_sessions(url)
    acts = {
        "append": lambda: store.append([ROW]),
        "hold": store.hold,
        "probe": store.probe,
        "snapshots": store.snapshots,
    }
    with pytest.raises(JournalLostError, match="and with it the journal"):
        acts[act]()
    other = PostgresStore.connect(url, "yard")
    assert other.try_lock()
    assert list(other.events(0)) == []
    other.close()


def test_the_database_ends_the_session_of_a_holder_that_hangs(postgres: PostgresServer) -> None:
    """Its lease is a setting of its own session: a scheduler that is cut off or stands still does not keep the lock."""
    url = postgres.database()
    store = PostgresStore.connect(url, "yard")
    assert store.try_lock()
    store.hold()
    with store._db.cursor() as cursor:  # pyright: ignore[reportPrivateUsage]
        cursor.execute("SELECT current_setting('idle_session_timeout'), current_setting('synchronous_commit')")
        assert cursor.fetchone() == ("10s", "on")
    store.close()


def test_a_database_that_takes_nothing_more_is_unavailable_and_not_lost(postgres: PostgresServer) -> None:
    """The session goes on, so the scheduler may try again when there is room."""
    url = postgres.database()
    store = PostgresStore.connect(url, "yard")
    assert store.try_lock()
    with psycopg.connect(url, autocommit=True) as administrator:
        administrator.execute("ALTER TABLE events ADD CONSTRAINT full_disk CHECK (false)")
        with pytest.raises(JournalLostError):
            store.append([ROW])
        administrator.execute("ALTER TABLE events DROP CONSTRAINT full_disk")
        administrator.execute("ALTER TABLE events RENAME TO gone")
        with pytest.raises(JournalUnavailableError):
            store.append([ROW])
        administrator.execute("ALTER TABLE gone RENAME TO events")
    store.append([ROW])
    assert list(store.events(0)) == [ROW]
    store.close()


def test_a_database_that_cannot_be_reached_is_said_so() -> None:
    """The message names the setting and holds no password."""
    with pytest.raises(JournalUnavailableError, match="MUSTER_DATABASE_URL") as error:
        PostgresStore.connect("postgresql://u:secret@127.0.0.1:1/x", "yard")
    assert "secret" not in str(error.value)
