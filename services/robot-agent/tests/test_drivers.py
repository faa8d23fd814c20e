"""One contract for every driver: what an agent may count on, whichever machine is behind it."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing

import pytest
from muster_bus.testing import RouterProcess, running_bus, service_process
from muster_robot_agent.drivers.kinematic import KinematicClock, KinematicDriver
from muster_robot_agent.drivers.kinematic_world import KinematicWorld
from muster_robot_agent.drivers.port import Driver
from muster_robot_agent.drivers.sim import SimDriver
from muster_robot_agent.machine import Order
from muster_schemas.sim import Telemetry
from muster_schemas.site import Site

EXCAVATOR, TRUCK = "robot_excavator_01", "robot_dump_truck_01"
WITHIN_S = 240.0
Make = Callable[[str], Driver]


@contextlib.asynccontextmanager
async def _kinematic(site: Site) -> AsyncGenerator[Make]:
    world = KinematicWorld(site, [EXCAVATOR, TRUCK])
    clock = KinematicClock(world, 5.0)
    running = asyncio.create_task(clock.run())
    yield lambda robot_id: KinematicDriver(world, clock, robot_id)
    running.cancel()


@contextlib.asynccontextmanager
async def _sim(site: Site, router: RouterProcess) -> AsyncGenerator[Make]:
    async with (
        running_bus(router) as bus,
        service_process("muster_sim", router, {"MUSTER_SPEED_FACTOR": "5"}),
    ):
        yield lambda robot_id: SimDriver(bus, robot_id, site.command_timeout_s)


@pytest.fixture(params=["kinematic", "sim"])
async def make_driver(request: pytest.FixtureRequest, site: Site, router: RouterProcess) -> AsyncGenerator[Make]:
    """Provide a maker of drivers, of each kind in turn."""
    kind = _kinematic(site) if request.param == "kinematic" else _sim(site, router)
    async with kind as make:
        yield make


async def drive_until(driver: Driver, order: Order, done: Callable[[Telemetry], bool]) -> list[Telemetry]:
    """Give the order at every telemetry until the condition holds; return what was sensed."""
    seen: list[Telemetry] = []
    async with asyncio.timeout(WITHIN_S), aclosing(driver.telemetry()) as stream:
        async for telemetry in stream:
            seen.append(telemetry)
            if done(telemetry):
                return seen
            driver.apply(order, telemetry.site_time_s)
    raise AssertionError("the telemetry ended")


async def test_telemetry_is_the_robots_own_and_its_time_grows(make_driver: Make) -> None:
    """It begins at home, and site time never goes back."""
    seen: list[Telemetry] = []
    await drive_until(make_driver(TRUCK), Order(), lambda t: seen.append(t) or len(seen) >= 10)
    assert {t.robot_id for t in seen} == {TRUCK}
    assert (seen[0].pose.x, seen[0].pose.y) == pytest.approx((-28, -4), abs=0.1)
    times = [t.site_time_s for t in seen]
    assert times == sorted(times)
    assert times[-1] > times[0]


async def test_an_order_to_drive_moves_the_machine_its_way(make_driver: Make) -> None:
    """Forward is forward, left is positive."""
    seen = await drive_until(make_driver(TRUCK), Order(speed_mps=1.0, turn_radps=0.2), lambda t: t.pose.x > -25)
    assert seen[-1].pose.y > seen[0].pose.y
    assert seen[-1].pose.yaw > 0
    assert max(t.speed_mps for t in seen) == pytest.approx(1.0, abs=0.2)


async def test_without_orders_the_machine_halts(make_driver: Make) -> None:
    """Nobody has to tell it: no order for the command timeout, and it stands."""
    driver = make_driver(TRUCK)
    await drive_until(driver, Order(speed_mps=1.0), lambda t: t.speed_mps > 0.5)
    async with asyncio.timeout(WITHIN_S), aclosing(driver.telemetry()) as stream:
        async for telemetry in stream:
            if abs(telemetry.speed_mps) < 0.01:
                break


async def test_joints_go_where_they_are_sent_and_not_beyond_their_limits(make_driver: Make) -> None:
    """The bed rises to the asked angle; an impossible one ends at the limit."""
    driver = make_driver(TRUCK)
    await drive_until(driver, Order(joints={"bed": 0.5}), lambda t: abs(t.joints["bed"] - 0.5) < 0.02)
    seen = await drive_until(driver, Order(joints={"bed": 3.0}), lambda t: t.joints["bed"] > 1.08)
    assert seen[-1].joints["bed"] < 1.12


async def test_driving_and_joints_go_together(make_driver: Make) -> None:
    """One order moves tracks and upper body."""
    order = Order(speed_mps=0.5, joints={"swing": 0.4})
    seen = await drive_until(
        make_driver(EXCAVATOR), order, lambda t: abs(t.joints["swing"] - 0.4) < 0.02 and t.pose.x > -27.5
    )
    assert seen[-1].load.empty
