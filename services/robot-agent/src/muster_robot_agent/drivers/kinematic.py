"""The `kinematic` driver: machines of a `KinematicWorld` in this process, against the wall clock."""

import asyncio
from collections.abc import AsyncGenerator

from muster_schemas.sim import Telemetry

from muster_robot_agent.machine import Order

from .kinematic_world import STEP_S, KinematicWorld

_LONGEST_LAG_S = 0.5
"""A process that was held up longer than this does not make up for it."""


class KinematicDriver:
    """One machine of the world."""

    def __init__(self, world: KinematicWorld, clock: "KinematicClock", robot_id: str) -> None:
        self._world = world
        self._clock = clock
        self._robot_id = robot_id

    async def telemetry(self) -> AsyncGenerator[Telemetry]:
        """Yield what the machine senses at each step of the world."""
        while True:
            await self._clock.ticked()
            yield self._world.telemetry(self._robot_id)

    def apply(self, order: Order, site_time_s: float) -> None:  # noqa: ARG002  (the port's)
        """Send what the machine is to do now."""
        self._world.command(self._robot_id, order)


class KinematicClock:
    """Lets a world's time pass, and wakes its drivers after each step."""

    def __init__(self, world: KinematicWorld, speed_factor: float) -> None:
        self._world = world
        self._period_s = STEP_S / speed_factor
        self._tick = asyncio.Event()

    async def ticked(self) -> None:
        """Return after the next step."""
        await self._tick.wait()

    async def run(self) -> None:
        """Advance the world until cancelled."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + self._period_s, loop.time() - _LONGEST_LAG_S)
            await asyncio.sleep(max(due - loop.time(), 0))
            self._world.advance()
            self._tick.set()
            self._tick.clear()
