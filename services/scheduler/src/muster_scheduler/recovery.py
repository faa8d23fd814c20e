"""From the store back to the core: the newest snapshot that is whole, and the events after it."""

import structlog

from .core.core import Core
from .core.errors import NotPossibleError
from .core.memory import load
from .core.transitions import InvalidTransition
from .journal import Journal, JournalCorruptError

_log = structlog.stdlib.get_logger(__name__)


def replay(journal: Journal) -> Core:
    """Return the core as its journal left it. A damaged snapshot is passed over for the one before, or the beginning.

    Raises:
        JournalCorruptError: the journal cannot be read, or tells what cannot have happened.

    """
    problem: JournalCorruptError | None = None
    for snapshot in journal.snapshots():
        try:
            core = Core(load(journal.begin_at(snapshot)))
            _live_through(core, journal)
        except (JournalCorruptError, ValueError) as error:
            problem = problem or journal.corrupt(f"the snapshot after event {snapshot.seq} is of no use ({error})")
            _log.warning("snapshot_passed_over", after_event=snapshot.seq, error=str(error)[:1000])
        else:
            return core
    core = Core()
    journal.begin()
    try:
        _live_through(core, journal)
    except JournalCorruptError as error:
        raise problem or error from error
    return core


def _live_through(core: Core, journal: Journal) -> None:
    for event in journal.events():
        try:
            core.handle(event)
        except (InvalidTransition, NotPossibleError, KeyError, ValueError) as error:
            raise journal.corrupt(f"event {journal.seq} ({event.kind}) cannot have happened: {error}") from error
