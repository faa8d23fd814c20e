"""Which store the settings mean, and taking it: at once, or standing by until the other scheduler is gone."""

import time
from typing import Final

import structlog

from muster_scheduler.settings import SchedulerSettings

from .port import JournalLostError, JournalUnavailableError, Store
from .postgres import PostgresStore
from .sqlite import SqliteStore

POLL_S: Final = 0.5
"""How often one that stands by tries to take over."""
_LOG_S: Final = 60.0

_log = structlog.stdlib.get_logger(__name__)


def take(settings: SchedulerSettings, site: str) -> Store:
    """Return the store once this process holds it. With PostgreSQL that may take until another scheduler ends.

    Raises:
        JournalError: it cannot be used, or (SQLite) another process holds it.

    """
    if settings.database_url is None:
        return SqliteStore.open(settings.data_dir / "scheduler", site)
    return _stand_by(settings.database_url.get_secret_value(), site)


def open_for_reading(settings: SchedulerSettings, site: str) -> Store:
    """Return the store of a journal that another process holds; it can only be read.

    Raises:
        JournalError: there is none, or it is another site's.

    """
    if settings.database_url is None:
        return SqliteStore.read(settings.data_dir / "scheduler", site)
    return PostgresStore.read(settings.database_url.get_secret_value(), site)


def _stand_by(url: str, site: str) -> Store:
    """Take the lock, whatever happens to the database meanwhile."""
    said = ("", float("-inf"))
    while True:
        try:
            store = PostgresStore.connect(url, site)
            while not store.try_lock():
                said = _say("standing_by", store.holder(), said)
                time.sleep(POLL_S)
        except (JournalUnavailableError, JournalLostError) as error:
            said = _say("database_unreachable", str(error).strip(), said)
            time.sleep(POLL_S)
        else:
            _log.info("journal_taken", where=store.where)
            return store


def _say(event: str, what: str, before: tuple[str, float]) -> tuple[str, float]:
    """Log it if it is new or was said long ago."""
    now = time.monotonic()
    if (event + what) == before[0] and now - before[1] < _LOG_S:
        return before
    if event == "standing_by":
        _log.info(event, active=what, hint="this scheduler takes over when the active one ends")
    else:
        _log.warning(event, error=what)
    return event + what, now
