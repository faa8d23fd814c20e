"""When a site is ready: every process answers, every robot is there, and every thing of its file is on the map."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass, field
from typing import Any

import httpx
from muster_bus import Bus, open_bus
from muster_schemas.channels import OBJECT, ROBOT_ALIVE, ROBOT_STATE, SERVICE_ALIVE, Channel
from muster_schemas.site import Site

from .errors import CliError
from .processes import Plan
from .record import DataDirectory, Standing

_SERVICES = ("sim", "vision", "scheduler", "planner")
_POLL_S = 0.2
_LOG_LINES = 8
_LOG_CHARACTERS = 2000
_TRIES = 4
"""A process that has ended so often before the site was ready is not going to run."""


@dataclass(frozen=True)
class Missing:
    """What a site still lacks; empty when it is ready."""

    services: tuple[str, ...] = ()
    robots: tuple[str, ...] = ()
    objects: tuple[str, ...] = ()
    interface: str = ""
    """Why the operator's interface is not ready yet."""

    @property
    def parts(self) -> list[str]:
        """What is missing, in words."""
        found = [
            f"{kind}: {', '.join(names)}"
            for kind, names in (("services", self.services), ("robots", self.robots), ("objects", self.objects))
            if names
        ]
        return found + ([f"interface: {self.interface}"] if self.interface else [])


@dataclass
class _Seen:
    services: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    robots: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    machines: set[str] = field(default_factory=set[str])
    """Robots whose machine answers: the agent has told where it stands."""
    objects: set[str] = field(default_factory=set[str])
    interface: str = "does not answer yet"

    def missing(self, site: Site) -> Missing:
        services = {name for name, _ in self.services}
        robots = {name for name, _ in self.robots} & self.machines
        return Missing(
            services=tuple(s for s in _SERVICES if s not in services),
            robots=tuple(r.id for r in site.robots if r.id not in robots),
            objects=tuple(t.name for t in site.things if t.name not in self.objects),
            interface=self.interface,
        )


async def wait_until_ready(
    plan: Plan, site: Site, directory: DataDirectory, within_s: float, tell: Callable[[Missing], None]
) -> None:
    """Return once the site is ready; `tell` is called whenever something less is missing.

    Raises:
        CliError: it is not ready in time, a process gave up, or the supervisor ended.

    """
    seen = _Seen()
    last = Missing()
    try:
        async with asyncio.timeout(within_s), open_bus(plan.site, [plan.endpoint]) as bus, _watching(bus, plan, seen):
            while True:
                _check_processes(directory)
                now = seen.missing(site)
                if not now.parts:
                    return
                if now != last:
                    tell(now)
                    last = now
                await asyncio.sleep(_POLL_S)
    except TimeoutError:
        lacking = "; ".join(seen.missing(site).parts)
        raise CliError(
            f"The site is not ready after {within_s:.0f} s. Missing: {lacking}. Logs: {directory.root / 'logs'}."
        ) from None


@contextlib.asynccontextmanager
async def _watching(bus: Bus, plan: Plan, seen: _Seen) -> AsyncGenerator[None]:
    follows = (
        _follow_tokens(bus, SERVICE_ALIVE, "service", seen.services),
        _follow_tokens(bus, ROBOT_ALIVE, "robot_id", seen.robots),
        _follow_machines(bus, seen),
        _follow_objects(bus, seen),
        _follow_interface(plan.url, seen),
    )
    tasks = [asyncio.create_task(follow) for follow in follows]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _follow_tokens(bus: Bus, channel: Channel[Any], field: str, alive: set[tuple[str, str]]) -> None:
    async with bus.watch(channel) as changes:
        async for change in changes:
            one = (change.ids[field], change.ids["boot_id"])
            alive.add(one) if change.alive else alive.discard(one)


async def _follow_machines(bus: Bus, seen: _Seen) -> None:
    async with bus.subscribe(ROBOT_STATE) as messages:
        async for received in messages:
            if received.message and not received.message.fault:
                seen.machines.add(received.ids["robot_id"])


async def _follow_objects(bus: Bus, seen: _Seen) -> None:
    async with bus.subscribe(OBJECT) as messages:
        async for received in messages:
            name = received.ids["object_name"]
            seen.objects.add(name) if received.message else seen.objects.discard(name)


async def _follow_interface(url: str, seen: _Seen) -> None:
    async with httpx.AsyncClient(base_url=url, timeout=2.0) as client:
        while True:
            try:
                answer = await client.get("/readyz")
                seen.interface = "" if answer.is_success else f"answers {answer.status_code}"
            except httpx.HTTPError:
                seen.interface = "does not answer yet"
            await asyncio.sleep(_POLL_S)


def _check_processes(directory: DataDirectory) -> None:
    record = directory.read()
    if record is None:
        raise CliError(f"The site's supervisor ended; see {directory.log_of('supervisor')}.")
    for process in record.processes:
        if process.standing is Standing.GIVEN_UP or process.restarts >= _TRIES:
            log = directory.log_of(process.name)
            tail = "\n".join(log.read_text(errors="replace").splitlines()[-_LOG_LINES:])
            raise CliError(
                f"{process.name} cannot run (exit code {process.exit_code}). "
                f"The end of {log}:\n{tail[-_LOG_CHARACTERS:]}"
            )
