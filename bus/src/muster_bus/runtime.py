"""`run`: the life of every service, from its first log line to its exit code.

Exit codes: 0 after SIGTERM or SIGINT; 1 after an uncaught error or a drain that took too long; 69 if the same service
or robot is already alive; 70 if the event loop stood still; 78 if the settings or the site file cannot be used.
"""

import asyncio
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Awaitable, Callable
from typing import Final, Literal, NoReturn

import structlog
from muster_schemas.ids import check_id, new_boot_id
from muster_schemas.site import SiteError, load_site

from . import crash, logs
from .bus import Bus, open_bus
from .errors import AlreadyRunningError
from .identity import Identity, sole
from .settings import BAD_SETTINGS_EXIT, ServiceSettings
from .watchdog import watch_loop

Main = Callable[[Bus, asyncio.Event], Awaitable[None]]

ALREADY_RUNNING_EXIT: Final = 69
"""Exit code of a process whose service or robot is alive elsewhere (EX_UNAVAILABLE)."""

_CLOSE_S = 3.0

_log = structlog.stdlib.get_logger(__name__)


def run(
    service: str,
    settings: ServiceSettings,
    main: Main,
    *,
    identity: tuple[Literal["service", "robot"], str] | None = None,
    drain_s: float = 10.0,
    stall_limit_s: float = 5.0,
) -> NoReturn:
    """Run a service until SIGTERM or SIGINT and end the process with its exit code.

    Args:
        service: its name, in logs and in its liveliness token.
        settings: as read from the environment.
        main: does the work; it returns soon after the event that it is given is set.
        identity: what there may be only one of on the site; by default the service.
        drain_s: how long `main` may take to return once asked to.
        stall_limit_s: how long the event loop may stand still before the process is ended.

    """
    boot_id = new_boot_id()
    try:
        site = load_site(settings.site_file).name
    except SiteError as error:
        _end(BAD_SETTINGS_EXIT, f"{service}: {error}")
    who = Identity(*identity) if identity else Identity("service", service)
    check_id(who.name, who.kind)
    bound = {"service": service, "boot_id": boot_id, "site": site}
    logs.set_up(settings.log_level, **bound, **({"robot": who.name} if who.kind == "robot" else {}))
    if settings.crash_at is not None:
        crash.on_passing(crash.kill_at(settings.crash_at))
    life = _Life(who, settings, main, drain_s)
    try:
        code = asyncio.run(life.run(site, boot_id, stall_limit_s))
    except AlreadyRunningError as error:
        _end(ALREADY_RUNNING_EXIT, f"{service}: {error}")
    except Exception:  # noqa: BLE001  (the last place that can log it)
        _log.critical("crashed", exc_info=True)
        _end(1)
    _log.info("stopped", exit_code=code)
    _end(code)


def _end(code: int, message: str = "") -> NoReturn:
    """End the process for certain: threads that hang must not leave a zombie whose token says "alive"."""
    if message:
        sys.stderr.write(message + "\n")
    last_resort = threading.Timer(_CLOSE_S, os._exit, (code,))
    last_resort.daemon = True
    last_resort.start()
    sys.exit(code)


class _Life:
    def __init__(self, who: Identity, settings: ServiceSettings, main: Main, drain_s: float) -> None:
        self._who = who
        self._settings = settings
        self._main = main
        self._drain_s = drain_s
        self._stop = asyncio.Event()

    async def run(self, site: str, boot_id: str, stall_limit_s: float) -> int:
        """Connect, announce, work, drain; return the exit code."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._on_signal, number)
        _log.info("starting", connect=list(self._settings.connect))
        async with watch_loop(stall_limit_s):
            work = asyncio.create_task(self._work(site, boot_id), name="main")
            stopping = asyncio.create_task(self._stop.wait(), name="stop")
            await asyncio.wait((work, stopping), return_when=asyncio.FIRST_COMPLETED)
            stopping.cancel()
            if not work.done():
                await asyncio.wait((work,), timeout=self._drain_s + _CLOSE_S)
            if not work.done():
                _log.error("drain_too_slow", limit_s=self._drain_s)
                work.cancel()
                await asyncio.wait((work,), timeout=_CLOSE_S)
                return 1
            return await work

    async def _work(self, site: str, boot_id: str) -> int:
        bus_context = open_bus(site, self._settings.connect, boot_id=boot_id)
        opening = asyncio.create_task(bus_context.__aenter__(), name="connect")
        if not await self._unless_stopped(opening):
            return 0
        bus = opening.result()
        try:
            async with sole(bus, self._who) as must_yield:
                _log.info("alive")
                return await self._serve(bus, must_yield)
        finally:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(bus_context.__aexit__(None, None, None), _CLOSE_S)

    async def _serve(self, bus: Bus, must_yield: asyncio.Event) -> int:
        serving = asyncio.ensure_future(self._main(bus, self._stop))
        yielding = asyncio.create_task(must_yield.wait(), name="yield")
        await asyncio.wait((serving, yielding), return_when=asyncio.FIRST_COMPLETED)
        yielding.cancel()
        yielded = must_yield.is_set()
        if yielded:
            self._stop.set()
        await serving
        return ALREADY_RUNNING_EXIT if yielded else 0

    async def _unless_stopped(self, task: "asyncio.Task[Bus]") -> bool:
        """Wait for the task; if asked to stop before it is done, cancel it and return False."""
        stopping = asyncio.create_task(self._stop.wait())
        await asyncio.wait((task, stopping), return_when=asyncio.FIRST_COMPLETED)
        stopping.cancel()
        if task.done():
            return True
        task.cancel()
        return False

    def _on_signal(self, number: int) -> None:
        if self._stop.is_set():
            _log.warning("stopping_at_once", signal=signal.Signals(number).name)
            os._exit(128 + number)
        _log.info("stopping", signal=signal.Signals(number).name)
        self._stop.set()
