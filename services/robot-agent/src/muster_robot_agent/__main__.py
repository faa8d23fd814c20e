"""`python -m muster_robot_agent`: the agent of one robot, or of several kinematic ones."""

import asyncio
import contextlib
import sys
import time
from collections.abc import AsyncGenerator, Sequence
from typing import Any

from muster_bus import Bus
from muster_bus.identity import Identity, sole
from muster_bus.runtime import run
from muster_bus.settings import BAD_SETTINGS_EXIT, read
from muster_schemas.site import Site, SiteError, load_site

from .agent import RobotAgent
from .drivers.kinematic import KinematicClock, KinematicDriver
from .drivers.kinematic_world import KinematicWorld
from .drivers.port import Driver
from .drivers.sim import SimDriver
from .following import follow_site
from .history import History
from .journal import Journal
from .settings import AgentSettings
from .surroundings import SiteView


async def serve(bus: Bus, stop: asyncio.Event, settings: AgentSettings, site: Site) -> None:
    """Run the agents of this process until asked to stop."""
    view = SiteView(site)
    history = History(settings.history_file)
    async with contextlib.AsyncExitStack() as stack:
        drivers = await stack.enter_async_context(_drivers(bus, settings, site))
        agents: list[RobotAgent] = []
        for robot_id in settings.robot_id:
            journal = stack.enter_context(Journal(settings.data_dir, robot_id))
            journal.prune(time.time())
            agents.append(RobotAgent(bus, view, robot_id, drivers[robot_id], journal, history))
        yields = [
            await stack.enter_async_context(sole(bus, Identity("robot", robot_id)))
            for robot_id in settings.robot_id[1:]
        ]
        work = [asyncio.create_task(a.run()) for a in agents]
        work.append(asyncio.create_task(follow_site(bus, view)))
        ends = [asyncio.create_task(event.wait()) for event in (stop, *yields)]
        await asyncio.wait([*work, *ends], return_when=asyncio.FIRST_COMPLETED)
        await _cancelled([*work, *ends])


async def _cancelled(tasks: "Sequence[asyncio.Task[Any]]") -> None:
    """End the tasks; raise what one of them failed with."""
    for task in tasks:
        task.cancel()
    for result in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(result, Exception):
            raise result


@contextlib.asynccontextmanager
async def _drivers(bus: Bus, settings: AgentSettings, site: Site) -> AsyncGenerator[dict[str, Driver]]:
    """Provide each robot's driver; the clock of kinematic machines runs as long."""
    if settings.driver == "sim":
        yield {r: SimDriver(bus, r, site.command_timeout_s) for r in settings.robot_id}
        return
    world = KinematicWorld(site, settings.robot_id)
    clock = KinematicClock(world, settings.speed_factor)
    running = asyncio.create_task(clock.run())
    try:
        yield {r: KinematicDriver(world, clock, r) for r in settings.robot_id}
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


def main() -> None:
    """Read the settings and run."""
    settings = read(AgentSettings)
    try:
        site = load_site(settings.site_file)
        for robot_id in settings.robot_id:
            site.card(robot_id, "boot-check")
    except SiteError as error:
        raise SystemExit(_complain(error)) from error

    async def work(bus: Bus, stop: asyncio.Event) -> None:
        await serve(bus, stop, settings, site)

    run("robot_agent", settings, work, identity=("robot", settings.robot_id[0]))


def _complain(error: SiteError) -> int:
    sys.stderr.write(f"robot_agent: {error}\n")
    return BAD_SETTINGS_EXIT


if __name__ == "__main__":
    main()
