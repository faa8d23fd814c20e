"""`python -m muster_scheduler`: the scheduler of one site."""

import asyncio
import gc
import sys

from muster_bus import Bus
from muster_bus.runtime import run
from muster_bus.settings import BAD_SETTINGS_EXIT, ServiceSettings, read
from muster_schemas.site import SiteError, load_site

from .core.events import Policy
from .engine import replay
from .journal import Journal, JournalError
from .shell import Shell

JOURNAL_EXIT = 74
"""Exit code when the journal is damaged or held by another process (EX_IOERR)."""


def main() -> None:
    """Run until SIGTERM or SIGINT; refuse to start on a damaged journal or beside another scheduler."""
    settings = read(ServiceSettings)
    try:
        site = load_site(settings.site_file)
    except SiteError as error:
        sys.stderr.write(f"scheduler: {error}\n")
        sys.exit(BAD_SETTINGS_EXIT)

    try:
        journal = Journal.open(settings.data_dir / "scheduler", site.name)
        core = replay(journal)
    except JournalError as error:
        sys.stderr.write(f"scheduler: {error}\n")
        sys.exit(JOURNAL_EXIT)
    gc.freeze()  # what was replayed stays, so searching it for garbage again and again would only hold up robots

    async def serve(bus: Bus, stop: asyncio.Event) -> None:
        await Shell(bus, site, core, journal).run(stop, Policy())

    run("scheduler", settings, serve)


if __name__ == "__main__":
    main()
