"""The life of a service process: start, one at a time, stop, crash, stall."""

import asyncio
import signal

import pytest
from muster_bus import Bus
from muster_bus.testing import Process, RouterProcess, eventually, running_bus, service_process
from muster_schemas.channels import KEYWORDS, ROBOT_ALIVE, SERVICE_ALIVE


async def nobody(bus: Bus) -> bool:
    """Return whether no service is alive."""
    return not await bus.who_is_alive(SERVICE_ALIVE)


async def test_sigterm_drains_and_exits_0(shared_router: RouterProcess, programs: dict[str, str]) -> None:
    """Asked to end, a service finishes what it does, says so on the bus, and its token goes."""
    async with running_bus(shared_router) as bus, bus.subscribe(KEYWORDS) as words:
        async with service_process("lamp", shared_router, programs) as lamp:
            assert [ids["service"] for ids in await bus.who_is_alive(SERVICE_ALIVE)] == ["lamp"]
            assert await lamp.terminate() == 0
        received = await asyncio.wait_for(anext(words), 120)
        assert received.message is not None
        assert received.message.keywords == ("good night",)
        await eventually(lambda: nobody(bus))


async def test_logs_are_json_with_who_where_and_which_life(
    shared_router: RouterProcess, programs: dict[str, str]
) -> None:
    """Every line on stderr is JSON that carries service, site and boot id."""
    async with service_process("lamp", shared_router, programs) as lamp:
        await lamp.terminate()
    assert len(lamp.logs) == len(lamp.lines)
    assert {(line["service"], line["site"], line["boot_id"]) for line in lamp.logs} == {
        ("lamp", "yard", lamp.logs[0]["boot_id"])
    }
    assert [line["event"] for line in lamp.logs] == ["starting", "alive", "stopping", "stopped"]


async def test_a_second_one_refuses_to_start(shared_router: RouterProcess, programs: dict[str, str]) -> None:
    """The later process says in one line what is wrong and exits 69; the first one goes on."""
    async with service_process("lamp", shared_router, programs) as first:
        async with service_process("lamp", shared_router, programs, wait=False) as second:
            assert await second.ended() == 69
        assert "lamp: service lamp is already running on site yard" in second.lines[-1]
        assert first.exit_code is None


async def test_a_robot_has_one_agent_and_a_service_many_robots(
    shared_router: RouterProcess, programs: dict[str, str]
) -> None:
    """Agents of two robots live beside each other; a second agent of one robot does not."""
    one, two = ({**programs, "MUSTER_ROBOT_ID": name} for name in ("robot_a", "robot_b"))
    async with (
        running_bus(shared_router) as bus,
        service_process("lamp", shared_router, one),
        service_process("lamp", shared_router, two),
    ):
        assert {ids["robot_id"] for ids in await bus.who_is_alive(ROBOT_ALIVE)} == {"robot_a", "robot_b"}
        assert await bus.who_is_alive(SERVICE_ALIVE) == []
        async with service_process("lamp", shared_router, one, wait=False) as again:
            assert await again.ended() == 69
        assert "robot robot_a is already running" in again.lines[-1]


async def test_two_that_start_at_once_leave_one(shared_router: RouterProcess, programs: dict[str, str]) -> None:
    """However the race goes, exactly one of them stays."""
    async with (
        service_process("lamp", shared_router, programs, wait=False) as a,
        service_process("lamp", shared_router, programs, wait=False) as b,
    ):
        await eventually(lambda: 69 in (a.exit_code, b.exit_code))
        stays = b if a.exit_code == 69 else a
        await stays.until_logged("alive")
        assert stays.exit_code is None


async def test_the_next_life_starts_at_once_after_a_kill(
    shared_router: RouterProcess, programs: dict[str, str]
) -> None:
    """A process that was killed a moment ago is in nobody's way."""
    async with service_process("lamp", shared_router, programs) as first:
        first.signal(signal.SIGKILL)
        async with service_process("lamp", shared_router, programs) as second:
            assert second.exit_code is None
            await first.ended()


async def test_an_uncaught_error_ends_the_process(shared_router: RouterProcess, programs: dict[str, str]) -> None:
    """It exits 1 with the traceback in its log, and its token goes: no zombie says "alive"."""
    async with (
        running_bus(shared_router) as bus,
        service_process("lamp", shared_router, {**programs, "MUSTER_TROUBLE": "crash"}, wait=False) as lamp,
    ):
        assert await lamp.ended() == 1
        await eventually(lambda: nobody(bus))
    (crash,) = lamp.logged("crashed")
    assert "the lamp broke" in crash["exception"]


async def test_a_stalled_loop_ends_the_process(shared_router: RouterProcess, programs: dict[str, str]) -> None:
    """A loop that stands still longer than its limit ends the process with 70 and every thread's stack."""
    trouble = {**programs, "MUSTER_TROUBLE": "stall", "MUSTER_STALL_LIMIT_S": "0.5"}
    async with service_process("lamp", shared_router, trouble) as lamp:
        assert await lamp.ended() == 70
    assert "the event loop has stood still for 0.5 s" in lamp.output
    assert "lamp/__main__.py" in lamp.output


async def test_being_stopped_and_continued_is_no_stall(shared_router: RouterProcess, programs: dict[str, str]) -> None:
    """A process that was suspended loses its token, comes back, and is not taken for stalled."""
    quick = {**programs, "MUSTER_STALL_LIMIT_S": "1"}
    async with running_bus(shared_router) as bus, service_process("lamp", shared_router, quick) as lamp:
        lamp.signal(signal.SIGSTOP)
        try:
            await eventually(lambda: nobody(bus))
        finally:
            lamp.signal(signal.SIGCONT)

        async def back() -> bool:
            return bool(await bus.who_is_alive(SERVICE_ALIVE))

        await eventually(back)
        assert lamp.exit_code is None
        assert await lamp.terminate() == 0


async def test_a_drain_that_takes_too_long_is_cut_short(shared_router: RouterProcess, programs: dict[str, str]) -> None:
    """A service that does not return when asked ends with 1 and says so."""
    async with service_process("lamp", shared_router, {**programs, "MUSTER_TROUBLE": "deaf"}) as lamp:
        assert await lamp.terminate() == 1
    assert lamp.logged("drain_too_slow")


async def test_a_second_signal_ends_it_at_once(shared_router: RouterProcess, programs: dict[str, str]) -> None:
    """Whoever cannot wait for the drain asks twice."""
    patient = {**programs, "MUSTER_TROUBLE": "deaf", "MUSTER_DRAIN_S": "600"}
    async with service_process("lamp", shared_router, patient) as lamp:
        lamp.signal(signal.SIGTERM)
        await lamp.until_logged("stopping")
        lamp.signal(signal.SIGTERM)
        assert await lamp.ended() == 128 + signal.SIGTERM


async def test_it_waits_for_the_router_and_can_be_stopped_meanwhile(
    router: RouterProcess, programs: dict[str, str]
) -> None:
    """Without a router a service says so and tries on; SIGTERM still ends it with 0."""
    router.kill()
    async with service_process("lamp", router, programs, wait=False) as lamp:
        await lamp.until_logged("router_unreachable")
        assert await lamp.terminate() == 0
    async with service_process("lamp", router, programs, wait=False) as lamp:
        await lamp.until_logged("router_unreachable")
        router.start()
        await lamp.until_logged("alive")


async def test_a_service_outlives_its_router(router: RouterProcess, programs: dict[str, str]) -> None:
    """Killed and started again, the router finds the service's token again."""
    async with service_process("lamp", router, programs) as lamp:
        for _ in range(2):
            router.kill()
            router.start()

            async def back() -> bool:
                async with running_bus(router) as bus:
                    return bool(await bus.who_is_alive(SERVICE_ALIVE))

            await eventually(back)
        assert lamp.exit_code is None


@pytest.mark.parametrize(
    ("setting", "value", "said"),
    [
        ("MUSTER_SITE_FILE", "nowhere.yaml", "cannot read the site file nowhere.yaml"),
        ("MUSTER_CONNECT", "localhost:7447", "MUSTER_CONNECT: Value error, 'localhost:7447' is no endpoint"),
        ("MUSTER_CONNECT", "", "MUSTER_CONNECT: "),
        ("MUSTER_LOG_LEVEL", "loud", "MUSTER_LOG_LEVEL: "),
    ],
)
async def test_settings_that_cannot_be_used_are_named(
    shared_router: RouterProcess, programs: dict[str, str], setting: str, value: str, said: str
) -> None:
    """A wrong setting ends the process with 78 and one line that names it."""
    async with service_process("lamp", shared_router, {**programs, setting: value}, wait=False) as lamp:
        assert await lamp.ended() == 78
    assert len(lamp.lines) == 1
    assert said in lamp.lines[0]


async def test_a_taken_port_is_said_so(shared_router: RouterProcess) -> None:
    """A second router on the same endpoint ends with 69 and says what to look for."""
    second = Process("muster_bus.router", {"MUSTER_LISTEN": shared_router.endpoint})
    try:
        assert await second.ended() == 69
        assert "is another router running?" in second.lines[-1]
    finally:
        second.dispose()


async def test_the_router_ends_when_asked(router: RouterProcess) -> None:
    """SIGTERM ends the router with 0."""
    assert await router.process.terminate() == 0
