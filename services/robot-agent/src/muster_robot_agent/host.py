"""`python -m muster_robot_agent.host --robots all`: one process for the agents of many kinematic robots.

Each robot keeps its own journal, liveliness token, card and state, and is told and asked like any other. They share the
process, its session, what it knows of the site, and one world of machines.
"""

import argparse
import asyncio
import contextlib
import resource
import sys
import time
from collections.abc import AsyncGenerator, Sequence
from pathlib import Path
from typing import Any, Literal, NoReturn

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
from .settings import HostSettings
from .surroundings import SiteView

DriverName = Literal["sim", "kinematic"]


def run_agents(settings: HostSettings, robots: Sequence[str], driver: DriverName) -> NoReturn:
    """Be the agents of these robots until SIGTERM or SIGINT, and end the process."""
    try:
        site = load_site(settings.site_file)
        for robot_id in robots:
            site.card(robot_id, "boot-check")
    except SiteError as error:
        _refuse(str(error))

    async def work(bus: Bus, stop: asyncio.Event) -> None:
        await serve(bus, stop, settings, site, robots, driver)

    run("robot_agent", settings, work, identity=("robot", robots[0]))


async def serve(
    bus: Bus, stop: asyncio.Event, settings: HostSettings, site: Site, robots: Sequence[str], driver: DriverName
) -> None:
    """Run the agents until asked to stop. The first one's token is the process's own."""
    view = SiteView(site)
    history = History(settings.history_file)
    async with contextlib.AsyncExitStack() as stack:
        drivers = await stack.enter_async_context(_drivers(bus, settings, site, robots, driver))
        agents: list[RobotAgent] = []
        for robot_id in robots:
            journal = await stack.enter_async_context(_open_journal(settings.data_dir, robot_id))
            agents.append(RobotAgent(bus, view, robot_id, drivers[robot_id], journal, history))
        yields = [await stack.enter_async_context(sole(bus, Identity("robot", r))) for r in robots[1:]]
        work = [asyncio.create_task(a.run()) for a in agents]
        work.append(asyncio.create_task(follow_site(bus, view)))
        ends = [asyncio.create_task(event.wait()) for event in (stop, *yields)]
        await asyncio.wait([*work, *ends], return_when=asyncio.FIRST_COMPLETED)
        await _cancelled([*work, *ends])


@contextlib.asynccontextmanager
async def _open_journal(folder: Path, robot_id: str) -> AsyncGenerator[Journal]:
    """Open a journal and close it at the end; opening or closing hundreds in a row must not hold up the loop."""
    with Journal(folder, robot_id) as journal:
        journal.prune(time.time())
        await asyncio.sleep(0)
        yield journal
    await asyncio.sleep(0)


async def _cancelled(tasks: "Sequence[asyncio.Task[Any]]") -> None:
    """End the tasks; raise what one of them failed with."""
    for task in tasks:
        task.cancel()
    for result in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(result, Exception):
            raise result


@contextlib.asynccontextmanager
async def _drivers(
    bus: Bus, settings: HostSettings, site: Site, robots: Sequence[str], driver: DriverName
) -> AsyncGenerator[dict[str, Driver]]:
    """Provide each robot's driver; the clock of kinematic machines runs as long."""
    if driver == "sim":
        yield {r: SimDriver(bus, r, site.command_timeout_s) for r in robots}
        return
    world = KinematicWorld(site, robots)
    clock = KinematicClock(world, settings.speed_factor)
    running = asyncio.create_task(clock.run())
    try:
        yield {r: KinematicDriver(world, clock, r) for r in robots}
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


def chosen(wanted: str, site: Site) -> tuple[str, ...]:
    """Return the robots that `all`, `first..last` (in the order of the site's file) or `one,two` mean.

    Raises:
        ValueError: a robot is not in the site's file, a range is empty, or a robot is named twice.

    """
    everyone = [r.id for r in site.robots]
    if wanted == "all":
        return tuple(everyone)
    first, dots, last = wanted.partition("..")
    names = [first, last] if dots else [name.strip() for name in wanted.split(",")]
    for name in names:
        if name not in everyone:
            raise ValueError(f"robot {name!r} is not in the file of the site {site.name}")
    robots = everyone[everyone.index(first) : everyone.index(last) + 1] if dots else names
    if not robots or len(set(robots)) != len(robots):
        raise ValueError(f"{wanted[:80]!r} {'names a robot twice' if robots else 'is an empty range'}")
    return tuple(robots)


def _refuse(why: str) -> NoReturn:
    sys.stderr.write(f"robot_agent: {why}\n")
    raise SystemExit(BAD_SETTINGS_EXIT)


def main() -> None:
    """Read settings and arguments, and run."""
    parser = argparse.ArgumentParser(prog="python -m muster_robot_agent.host", description=__doc__)
    parser.add_argument("--robots", required=True, metavar="all|FIRST..LAST|ID,ID", help="robots of the site's file")
    wanted: str = parser.parse_args().robots
    settings = read(HostSettings)
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # each journal takes three open files
    try:
        robots = chosen(wanted, load_site(settings.site_file))
    except (SiteError, ValueError) as error:
        _refuse(str(error))
    run_agents(settings, robots, "kinematic")


if __name__ == "__main__":
    main()
