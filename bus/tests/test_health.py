"""The health check of containers, as they run it."""

import asyncio

from muster_bus.testing import Process, RouterProcess, running_bus
from muster_schemas.channels import ROBOT_ALIVE, SERVICE_ALIVE


async def health(router: RouterProcess, *arguments: str) -> int:
    """Run the check and return its exit code."""
    process = Process("muster_bus.health", router.environment, *arguments)
    try:
        return await process.ended()
    finally:
        await asyncio.to_thread(process.dispose)


async def test_whose_token_is_there_is_healthy(router: RouterProcess) -> None:
    """A service and a robot are each found by their own name only."""
    async with (
        running_bus(router) as bus,
        bus.alive(SERVICE_ALIVE, service="scheduler", boot_id=bus.boot_id),
        bus.alive(ROBOT_ALIVE, robot_id="robot_excavator_01", boot_id=bus.boot_id),
    ):
        codes = await asyncio.gather(
            health(router, "service", "scheduler"),
            health(router, "robot", "robot_excavator_01"),
            health(router, "service", "planner"),
            health(router, "robot", "scheduler"),
        )
    assert codes == [0, 0, 1, 1]


async def test_without_a_router_nothing_is_healthy(router: RouterProcess) -> None:
    """The check ends by itself and says no."""
    router.kill()
    assert await health(router, "service", "scheduler") == 1


async def test_wrong_arguments_are_told(router: RouterProcess) -> None:
    """It says how it is used."""
    assert await health(router, "scheduler") == 2
