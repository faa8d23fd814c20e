"""The router goes and comes back: no hole stays in state, tokens and subscriptions return, nothing raises."""

import asyncio
import signal
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest
from muster_bus import Bus, NoReplyError, Received
from muster_bus.testing import RouterProcess, eventually, running_bus
from muster_schemas.channels import KEYWORDS, MISSIONS, OBJECT, SERVICE_ALIVE
from muster_schemas.examples import EXAMPLES
from muster_schemas.rpc import MissionsQuery, MissionsReply
from muster_schemas.world import Keywords, MapObject


def put(bus: Bus, name: str, confidence: float) -> None:
    """Publish an object of the map."""
    example = EXAMPLES["object"].message.model_dump(by_alias=True)
    message = MapObject.model_validate({**example, "name": name, "confidence": confidence})
    bus.publish(OBJECT, message, object_name=name)


class Map:
    """What a subscriber knows of the map, gathered by a task of its own."""

    def __init__(self) -> None:
        self.history: list[tuple[str, float | None]] = []

    @property
    def now(self) -> dict[str, float | None]:
        """The last value of each name."""
        return dict(self.history)

    def note(self, received: Received[MapObject]) -> None:
        """Take in one message."""
        confidence = received.message.confidence if received.message else None
        self.history.append((received.ids["object_name"], confidence))


@asynccontextmanager
async def following(bus: Bus) -> AsyncGenerator[Map]:
    """Follow the map while entered."""
    known = Map()

    async def follow() -> None:
        async with bus.subscribe(OBJECT) as messages:
            async for received in messages:
                known.note(received)

    task = asyncio.create_task(follow())
    try:
        yield known
    finally:
        task.cancel()


@pytest.mark.parametrize("rejoins", ["subscriber and owner", "new subscriber"])
async def test_state_put_during_an_outage_arrives_after_it(router: RouterProcess, rejoins: str) -> None:
    """Values and retractions of the outage reach old and new subscribers once the router is back."""
    async with running_bus(router) as vision, running_bus(router) as reader, following(reader) as known:
        put(vision, "puddle1", 0.1)
        put(vision, "puddle2", 0.1)
        put(vision, "rock1", 0.1)
        await eventually(lambda: len(known.now) == 3)
        router.kill()
        await eventually(lambda: not vision.connected and not reader.connected)
        put(vision, "puddle1", 0.2)
        put(vision, "puddle1", 0.3)
        put(vision, "soil1", 0.4)
        vision.retract(OBJECT, object_name="puddle2")
        router.start()
        expected = {"puddle1": 0.3, "puddle2": None, "rock1": 0.1, "soil1": 0.4}
        if rejoins == "new subscriber":
            await eventually(lambda: vision.connected)
            async with running_bus(router) as late, following(late) as late_known:
                await eventually(lambda: late_known.now == {k: v for k, v in expected.items() if v})
        await eventually(lambda: known.now == expected)
        assert len(known.history) == len(set(known.history)), "a repeated value was taken for news"


async def test_an_owner_that_was_cut_off_alone_is_heard_again(router: RouterProcess) -> None:
    """The owner's link breaks (its router dies) while a subscriber on the same site only comes later."""
    async with running_bus(router) as vision:
        router.kill()
        await eventually(lambda: not vision.connected)
        put(vision, "puddle1", 0.5)
        router.start()
        async with running_bus(router) as late, following(late) as known:
            await eventually(lambda: known.now == {"puddle1": 0.5})


async def test_everything_works_again_after_an_outage(router: RouterProcess) -> None:
    """Subscriptions, servers and tokens that were there before need nothing from their service to be there again."""

    async def handle(_request: MissionsQuery) -> MissionsReply:
        return MissionsReply(missions=())

    presences: list[tuple[str, bool]] = []
    words: list[str] = []

    async def watch(bus: Bus) -> None:
        async with bus.watch(SERVICE_ALIVE) as changes:
            async for change in changes:
                presences.append((change.ids["service"], change.alive))  # noqa: PERF401  (it never ends)

    async def read(bus: Bus) -> None:
        async with bus.subscribe(KEYWORDS) as messages:
            async for received in messages:
                assert received.message is not None
                words.extend(received.message.keywords)

    async with (
        running_bus(router) as a,
        running_bus(router) as b,
        a.alive(SERVICE_ALIVE, service="scheduler", boot_id=a.boot_id),
        a.serve(MISSIONS, handle),
        asyncio.TaskGroup() as tasks,
    ):
        readers = [tasks.create_task(watch(b)), tasks.create_task(read(b))]
        await eventually(lambda: presences == [("scheduler", True)])
        for down in range(2):
            router.kill()
            await eventually(lambda: not a.connected and not b.connected)
            await eventually(lambda: presences[-1] == ("scheduler", False))
            with pytest.raises(NoReplyError):
                await b.ask(MISSIONS, MissionsQuery(), timeout_s=5)
            a.publish(KEYWORDS, Keywords(keywords=("lost",), asked_by="a"))
            router.start()
            await eventually(lambda: a.connected and b.connected)
            await eventually(lambda: presences[-1] == ("scheduler", True))

            async def answered() -> bool:
                try:
                    await b.ask(MISSIONS, MissionsQuery(), timeout_s=5)
                except NoReplyError:
                    return False
                return True

            await eventually(answered)

            def heard(word: str = f"word {down}") -> bool:
                a.publish(KEYWORDS, Keywords(keywords=(word,), asked_by="a"))
                return word in words

            await eventually(heard)
        for reader in readers:
            reader.cancel()
    assert "lost" not in words


async def test_a_router_that_hangs_is_noticed_and_its_return_too(router: RouterProcess) -> None:
    """A stopped router is an outage after the lease; when it goes on, state is mended."""
    async with running_bus(router) as vision, running_bus(router) as reader, following(reader) as known:
        put(vision, "puddle1", 0.1)
        await eventually(lambda: known.now == {"puddle1": 0.1})
        router.process.signal(signal.SIGSTOP)
        try:
            await eventually(lambda: not vision.connected and not reader.connected)
            put(vision, "puddle1", 0.2)
        finally:
            router.process.signal(signal.SIGCONT)
        await eventually(lambda: known.now == {"puddle1": 0.2})


async def test_a_bus_waits_for_its_router(router: RouterProcess) -> None:
    """A process may start before its router."""
    router.kill()

    async def connect() -> bool:
        async with running_bus(router) as bus:
            return bus.connected

    connecting = asyncio.create_task(connect())
    await asyncio.sleep(0)
    router.start()
    assert await asyncio.wait_for(connecting, 120)


async def test_waiting_for_a_router_can_be_given_up(router: RouterProcess) -> None:
    """Cancelling ends the wait at once."""
    router.kill()
    entering = asyncio.create_task(running_bus(router).__aenter__())
    await asyncio.sleep(0)
    entering.cancel()
    with pytest.raises(asyncio.CancelledError):
        await asyncio.wait_for(entering, 120)
