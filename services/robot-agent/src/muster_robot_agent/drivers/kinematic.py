"""The `kinematic` driver: machines of a `KinematicWorld` in this process, against the wall clock.

A machine at rest is felt five times a second and costs nothing in between, so one process can host hundreds of them.
"""

import asyncio
from collections.abc import AsyncGenerator
from typing import Final

from muster_schemas.sim import Telemetry

from muster_robot_agent.machine import Order

from .kinematic_world import STEP_S, KinematicWorld

_LONGEST_LAG_S = 0.5
"""A process that was held up longer than this does not make up for it."""
_REST_S: Final = 0.2
"""Between two telemetries of a machine at rest, in seconds of the wall clock."""


class KinematicDriver:
    """One machine of the world."""

    def __init__(self, world: KinematicWorld, clock: "KinematicClock", robot_id: str) -> None:
        self._world = world
        self._clock = clock
        self._robot_id = robot_id

    async def telemetry(self) -> AsyncGenerator[Telemetry]:
        """Yield what the machine senses at each step that may change it, and now and then while it is at rest."""
        while True:
            await self._clock.felt(self._robot_id)
            yield self._world.telemetry(self._robot_id)

    def apply(self, order: Order, site_time_s: float) -> None:  # noqa: ARG002  (the port's)
        """Send what the machine is to do now."""
        self._world.command(self._robot_id, order)


class KinematicClock:
    """Lets a world's time pass, and wakes the drivers of the machines that feel something."""

    def __init__(self, world: KinematicWorld, speed_factor: float) -> None:
        self._world = world
        self._period_s = STEP_S / speed_factor
        rounds = max(round(_REST_S / self._period_s), 1)
        robots = list(world.robots)
        self._at_rest = [robots[start::rounds] for start in range(rounds)]
        """Whom to wake at each step in turn, so that those at rest do not all wake at once."""
        self._waiting: dict[str, asyncio.Future[None]] = {}

    async def felt(self, robot_id: str) -> None:
        """Return after the next step that the machine feels."""
        waiting = self._waiting[robot_id] = asyncio.get_running_loop().create_future()
        await waiting

    async def run(self) -> None:
        """Advance the world until cancelled."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        step = 0
        while True:
            due = max(due + self._period_s, loop.time() - _LONGEST_LAG_S)
            await asyncio.sleep(max(due - loop.time(), 0))
            step += 1
            for robot_id in (*self._world.advance(), *self._at_rest[step % len(self._at_rest)]):
                waiting = self._waiting.pop(robot_id, None)
                if waiting is not None and not waiting.done():
                    waiting.set_result(None)
