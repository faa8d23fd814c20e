"""One life at a time for each service and each robot: the process that came later yields."""

import asyncio
import contextlib
import time
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from typing import Any, Literal

import structlog
from muster_schemas.channels import ROBOT_ALIVE, SERVICE_ALIVE, Channel

from .bus import Bus
from .errors import AlreadyRunningError
from .session import LEASE_S

_log = structlog.stdlib.get_logger(__name__)

_GONE_WITHIN_S = LEASE_S + 1.0
"""A token of a process that was killed or cut off goes within this long."""


@dataclass(frozen=True)
class Identity:
    """A service of the site, or the agent of one robot."""

    kind: Literal["service", "robot"]
    name: str

    @property
    def channel(self) -> Channel[Any]:
        """Where its token stands."""
        return SERVICE_ALIVE if self.kind == "service" else ROBOT_ALIVE

    @property
    def ids(self) -> dict[str, str]:
        """The ids of its token, without the boot id."""
        return {"service" if self.kind == "service" else "robot_id": self.name}


@contextlib.asynccontextmanager
async def sole(bus: Bus, identity: Identity) -> AsyncGenerator[asyncio.Event]:
    """Hold the identity's token while entered; the event is set if this process must yield after all.

    Raises:
        AlreadyRunningError: another process holds it.

    """
    await _until_free(bus, identity, earlier_only=False)
    async with bus.alive(identity.channel, boot_id=bus.boot_id, **identity.ids):
        # Two that start at the same moment see each other only now; the earlier one stays.
        await _until_free(bus, identity, earlier_only=True)
        must_yield = asyncio.Event()
        watching = asyncio.create_task(_watch(bus, identity, must_yield), name="identity")
        try:
            yield must_yield
        finally:
            watching.cancel()


async def _others(bus: Bus, identity: Identity, *, earlier_only: bool) -> list[str]:
    found = [ids["boot_id"] for ids in await bus.who_is_alive(identity.channel, **identity.ids)]
    return sorted(b for b in found if b != bus.boot_id and (b < bus.boot_id or not earlier_only))


async def _until_free(bus: Bus, identity: Identity, *, earlier_only: bool) -> None:
    give_up = time.monotonic() + _GONE_WITHIN_S
    while others := await _others(bus, identity, earlier_only=earlier_only):
        if time.monotonic() >= give_up:
            raise AlreadyRunningError(_message(bus, identity, others))
        await asyncio.sleep(0.1)


async def _watch(bus: Bus, identity: Identity, must_yield: asyncio.Event) -> None:
    """Look again whenever a token comes: one that was cut off at our start shows itself later."""
    async with bus.watch(identity.channel, **identity.ids) as changes:
        async for change in changes:
            if not change.alive or change.ids["boot_id"] >= bus.boot_id:
                continue
            try:
                await _until_free(bus, identity, earlier_only=True)
            except AlreadyRunningError as error:
                _log.error("yielding", reason=str(error))
                must_yield.set()
                return


def _message(bus: Bus, identity: Identity, others: list[str]) -> str:
    return (
        f"{identity.kind} {identity.name} is already running on site {bus.site} ({', '.join(others)}); "
        "stop that one first"
    )
