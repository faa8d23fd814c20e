"""The site on this machine: start it, stop it, show it, find its interface and its bus."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import psutil
from muster_bus import Bus, open_bus
from muster_schemas.site import Site
from rich.console import Console
from rich.table import Table

from . import launch
from .errors import CliError
from .processes import Driver, Options, plan_of
from .readiness import Missing, wait_until_ready
from .record import DataDirectory, SiteRecord, Standing
from .settings import CliSettings, read_site
from .views import seconds

READY_WITHIN_S = 600.0
_ROUTER_ANSWERS_WITHIN_S = 3.0
_COLOURS = {Standing.RUNNING: "green", Standing.GIVEN_UP: "bold red", Standing.RESTARTING: "yellow"}


def chosen(settings: CliSettings, site_file: Path | None) -> Site:
    """Return the site of the file that the operator named, else of the settings."""
    return read_site(site_file or settings.site_file)


def options(
    settings: CliSettings,
    site_file: Path | None,
    *,
    speed: float,
    port: int,
    bus_port: int,
    driver: Driver,
    planner: str,
) -> Options:
    """Return what the operator chose, with the settings for the rest."""
    return Options(
        site_file=site_file or settings.site_file,
        data_dir=settings.data_dir,
        bus_port=bus_port,
        port=port,
        speed_factor=speed,
        driver=driver,
        planner=planner,
        log_level=settings.log_level,
    )


def up(options: Options, console: Console) -> SiteRecord:
    """Start the site and wait until every part of it is ready; if one cannot run, stop the rest again.

    Raises:
        CliError: it is up already, a port is taken, or it did not become ready.

    """
    the_site = read_site(options.site_file)
    directory = DataDirectory(options.data_dir)
    plan = plan_of(the_site, options)
    began = time.monotonic()
    record = launch.start(plan, options, directory)
    total = len(plan.rest) + 1
    try:
        with console.status(f"Starting {total} processes") as line:

            def tell(missing: Missing) -> None:
                text = f"Waiting for {'; '.join(missing.parts)}"
                line.update(text) if console.is_terminal else console.print(text, highlight=False, soft_wrap=True)

            asyncio.run(wait_until_ready(plan, the_site, directory, READY_WITHIN_S, tell))
    except (CliError, KeyboardInterrupt):
        launch.stop(directory)
        raise
    console.print(
        f"Site {plan.site} is up after {seconds(time.monotonic() - began)}: {total} processes, "
        f"interface {plan.url}, bus {plan.endpoint}, logs in {directory.root / 'logs'}.",
        highlight=False,
        soft_wrap=True,
    )
    return record


def down(data_dir: Path, console: Console) -> None:
    """Stop the site and say so."""
    with console.status("Stopping the site"):
        was_up = launch.stop(DataDirectory(data_dir))
    console.print("The site is down." if was_up else "No site is up on this machine.")


def show(directory: DataDirectory, console: Console) -> bool:
    """Print the table of the site's processes; returns False if no site is up."""
    record = directory.read()
    if record is None:
        return False
    plan = record.plan
    console.print(
        f"Site {plan.site} ({plan.site_file}), up for {seconds(time.time() - record.started_at)}: "
        f"interface {plan.url}, bus {plan.endpoint}, "
        f"speed {plan.speed_factor:g}, driver {plan.driver}, planner {plan.planner}.",
        highlight=False,
        soft_wrap=True,
    )
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("process", "state", "pid", "memory", "for", "restarts", "last exit"):
        table.add_column(column)
    for p in record.processes:
        table.add_row(
            p.name,
            f"[{_COLOURS.get(p.standing, 'dim')}]{p.standing.value}[/]",
            str(p.pid or ""),
            _memory(p.pid),
            seconds(time.time() - p.since),
            str(p.restarts or ""),
            "" if p.exit_code is None else str(p.exit_code),
        )
    console.print(table)
    return True


def _memory(pid: int | None) -> str:
    if pid is None:
        return ""
    try:
        return f"{psutil.Process(pid).memory_info().rss / 1e6:.0f} MB"
    except psutil.Error:
        return ""


def url(settings: CliSettings) -> str:
    """Return the address of the interface: the one set, else of the site that is up here, else the usual one."""
    if settings.url:
        return settings.url
    record = DataDirectory(settings.data_dir).read()
    return record.plan.url if record else "http://127.0.0.1:8000"


async def on_bus(settings: CliSettings, work: Callable[[Bus], Awaitable[None]]) -> None:
    """Do something on the bus of the site that is up here, else of the site in the settings.

    Raises:
        CliError: no router answers.

    """
    record = DataDirectory(settings.data_dir).read()
    name, endpoints = (record.plan.site, (record.plan.endpoint,)) if record else (settings.site.name, settings.connect)
    opened = open_bus(name, endpoints)
    try:
        bus = await asyncio.wait_for(opened.__aenter__(), _ROUTER_ANSWERS_WITHIN_S)
    except TimeoutError:
        raise CliError(
            f"No router answers at {', '.join(endpoints)}. Start a site with `muster up`, or set MUSTER_CONNECT."
        ) from None
    try:
        await work(bus)
    finally:
        await opened.__aexit__(None, None, None)
