"""`python -m muster_sim`: simulate the site of `MUSTER_SITE_FILE` at `MUSTER_SPEED_FACTOR`."""

import asyncio

from muster_bus import Bus
from muster_bus.runtime import run
from muster_bus.settings import read
from muster_schemas.site import load_site

from .service import Simulator
from .settings import SimSettings
from .snapshot import SnapshotFile
from .world import World


def main() -> None:
    """Run the service until it is told to stop."""
    settings = read(SimSettings)

    async def work(bus: Bus, stop: asyncio.Event) -> None:
        site = load_site(settings.site_file)
        with World(site) as world:
            await Simulator(bus, world, settings.speed_factor, SnapshotFile(settings.data_dir, site)).run(stop)

    # The world is built, and each picture rendered, in one piece: seconds on a machine that is busy with other things.
    run("sim", settings, work, stall_limit_s=30.0)


if __name__ == "__main__":
    main()
