"""The witness beside the SQLite journal: a tail that was committed and is gone is noticed, and a new start says so."""

import shutil
from pathlib import Path

import pytest
from muster_scheduler.core.events import AnyEvent, Started, Tick
from muster_scheduler.journal import Journal, JournalCorruptError
from muster_scheduler.storage.witness import Witness, Witnessed

EVENTS: list[AnyEvent] = [Started(at=1, epoch=1), *[Tick(at=float(n)) for n in range(2, 30)]]
FRAME = 4096 + 24
"""Bytes of a page in SQLite's write-ahead log with its header; the log's own header has 32."""


@pytest.fixture
def crashed(tmp_path: Path) -> Path:
    """Provide what a power cut leaves: the journal's files with all events in the write-ahead log."""
    journal = Journal.open(tmp_path / "live", "yard")
    list(journal.events())
    for event in EVENTS:
        journal.append([event])
    shutil.copytree(tmp_path / "live", tmp_path / "crashed")
    journal.close()
    (tmp_path / "crashed" / "journal.sqlite-shm").unlink()
    return tmp_path / "crashed"


def read(directory: Path) -> list[AnyEvent]:
    """Return the events as a new start reads them."""
    journal = Journal.open(directory, "yard")
    try:
        return list(journal.events())
    finally:
        journal.close()


def test_what_was_committed_is_there_after_a_power_cut(crashed: Path) -> None:
    """Nothing is missing, and nothing is said to be."""
    assert read(crashed) == EVENTS


def test_a_changed_byte_anywhere_in_the_log_costs_nothing_or_is_noticed(crashed: Path, tmp_path: Path) -> None:
    """SQLite itself says nothing and takes the damaged frame for the end; the message says what to do."""
    whole = (crashed / "journal.sqlite-wal").read_bytes()
    noticed: list[str] = []
    for number, start in enumerate(range(40, len(whole), FRAME)):
        copy = tmp_path / f"copy{number}"
        shutil.copytree(crashed, copy)
        (copy / "journal.sqlite-wal").write_bytes(whole[:start] + bytes([whole[start] ^ 0x10]) + whole[start + 1 :])
        try:
            assert read(copy) == EVENTS
        except JournalCorruptError as error:
            noticed.append(str(error))
    assert len(noticed) > len(EVENTS)
    assert all("-wal" in said and "stop every robot" in said for said in noticed)


def test_a_log_that_was_thrown_away_is_noticed(crashed: Path) -> None:
    """The numbers of the missing events are told; without its witness the rest can be used knowingly."""
    (crashed / "journal.sqlite-wal").unlink()
    with pytest.raises(JournalCorruptError, match=rf"to {len(EVENTS)} were committed and are missing"):
        read(crashed)
    (crashed / "journal.witness").unlink()
    assert len(read(crashed)) < len(EVENTS)


def test_a_witness_that_is_behind_or_has_a_torn_entry_says_nothing_wrong(crashed: Path) -> None:
    """After a power cut it may be some commits old."""
    file = crashed / "journal.witness"
    newer_first = file.read_bytes()
    for slot in (0, 512):
        file.write_bytes(newer_first[:slot] + b"\xff" * 16 + newer_first[slot + 16 :])
        assert read(crashed) == EVENTS


def test_a_witness_without_a_whole_entry_stops_the_start(crashed: Path) -> None:
    """Both entries damaged is no power cut."""
    file = crashed / "journal.witness"
    file.write_bytes(bytes(b ^ 0xFF for b in file.read_bytes()))
    with pytest.raises(JournalCorruptError, match="witness"):
        read(crashed)


def test_the_witness_tells_the_newest_entry(tmp_path: Path) -> None:
    """Also to the next process."""
    witness = Witness(tmp_path / "witness")
    assert witness.read() is None
    for seq in (1, 2, 3):
        witness.write(seq, 10 * seq)
    witness.close()
    witness = Witness(tmp_path / "witness")
    assert witness.read() == Witnessed(3, 30)
    witness.close()
