"""`python -m muster_scheduler`: the scheduler of one site."""

import asyncio
import gc
import signal
import sys
from functools import partial

from muster_bus import Bus, logs
from muster_bus.runtime import run
from muster_bus.settings import BAD_SETTINGS_EXIT, read
from muster_schemas.site import SiteError, load_site

from .compaction import snapshot_elsewhere
from .core.events import Policy
from .journal import Journal, JournalError
from .recovery import replay
from .settings import SchedulerSettings
from .shell import Shell
from .storage.opening import take

JOURNAL_EXIT = 74
"""Exit code when the journal is damaged or held by another process (EX_IOERR)."""


def main() -> None:
    """Run until SIGTERM or SIGINT; refuse to start on a damaged journal or beside another scheduler.

    On PostgreSQL it first stands by for as long as another scheduler holds the journal. Only then does it say on the
    bus that the scheduler is alive, so there is never more than one.
    """
    settings = read(SchedulerSettings)
    try:
        site = load_site(settings.site_file)
    except SiteError as error:
        sys.stderr.write(f"scheduler: {error}\n")
        sys.exit(BAD_SETTINGS_EXIT)

    logs.set_up(settings.log_level, service="scheduler", site=site.name)
    signal.signal(signal.SIGTERM, _end)  # while it stands by; `run` has its own way
    try:
        journal = Journal(take(settings, site.name))
        core = replay(journal)
    except JournalError as error:
        sys.stderr.write(f"scheduler: {error}\n")
        sys.exit(JOURNAL_EXIT)
    gc.freeze()  # what was replayed stays, so searching it for garbage again and again would only hold up robots

    async def serve(bus: Bus, stop: asyncio.Event) -> None:
        make_snapshot = partial(snapshot_elsewhere, settings.environment())
        policy = Policy(failures=site.failures, approval=site.approval)
        await Shell(bus, site, core, journal, make_snapshot).run(stop, policy)

    run("scheduler", settings, serve)


def _end(*_: object) -> None:
    sys.exit(0)


if __name__ == "__main__":
    main()
