"""`python -m muster_planner`: the planner as a process; see `settings` for what it reads from the environment."""

import asyncio
import sys

from muster_bus import Bus
from muster_bus.runtime import run
from muster_bus.settings import BAD_SETTINGS_EXIT, read

from .service import bind, serve
from .settings import PlannerSettings


def main() -> None:
    """Run until SIGTERM or SIGINT; the address is taken first, so that a second planner fails at once and says why."""
    settings = read(PlannerSettings)
    try:
        listening = bind(settings)
    except OSError as error:
        sys.stderr.write(
            f"planner: cannot listen on {settings.host}:{settings.port}: {error.strerror}. "
            "Stop what listens there, or set MUSTER_PORT to another port.\n"
        )
        raise SystemExit(BAD_SETTINGS_EXIT) from error

    async def work(bus: Bus, stop: asyncio.Event) -> None:
        await serve(bus, stop, settings, listening)

    run("planner", settings, work)


if __name__ == "__main__":
    main()
