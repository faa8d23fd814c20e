"""State channels: the last value of each key, for whoever comes when."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import zenoh
from muster_bus import Bus, Received
from muster_bus.testing import RouterProcess, eventually, running_bus
from muster_schemas.channels import AREAS, OBJECT, ROBOT_CARD, all_of
from muster_schemas.examples import EXAMPLES
from muster_schemas.world import AreaRules, MapObject


def seen(name: str, confidence: float = 1.0) -> MapObject:
    """Return an object of the map."""
    example = EXAMPLES["object"].message.model_dump(by_alias=True)
    return MapObject.model_validate({**example, "name": name, "confidence": confidence})


def put(bus: Bus, name: str, confidence: float = 1.0) -> None:
    """Publish an object of the map."""
    bus.publish(OBJECT, seen(name, confidence), object_name=name)


async def take(messages: AsyncIterator[Received[MapObject]], count: int) -> list[Received[MapObject]]:
    """Return the next messages."""
    return [await asyncio.wait_for(anext(messages), 120) for _ in range(count)]


def values(received: list[Received[MapObject]]) -> list[tuple[str, float | None]]:
    """Return the names and values."""
    return [(r.ids["object_name"], r.message.confidence if r.message else None) for r in received]


async def test_a_late_joiner_gets_the_current_values_first(shared_router: RouterProcess, site: str) -> None:
    """Whoever subscribes later gets each key's last value, and only that, before anything new."""
    async with (
        running_bus(shared_router, site) as vision,
        running_bus(shared_router, site) as early,
        running_bus(shared_router, site) as late,
        early.subscribe(OBJECT) as early_messages,
    ):
        for confidence in (0.1, 0.2, 0.3):
            put(vision, "puddle1", confidence)
        put(vision, "puddle2", 0.5)
        await take(early_messages, 4)  # all of it has gone through the router
        async with late.subscribe(OBJECT) as messages:
            put(vision, "puddle1", 0.9)
            received = await take(messages, 3)
    assert sorted(values(received[:2])) == [("puddle1", 0.3), ("puddle2", 0.5)]
    assert values(received[2:]) == [("puddle1", 0.9)]


async def test_each_owner_answers_for_its_own_keys(shared_router: RouterProcess, site: str) -> None:
    """Robots' cards have an owner each; a late joiner gets all of them, and one of them if it asks for one."""
    example = EXAMPLES["robot_card"].message.model_dump()
    names = {"robot_a", "robot_b", "robot_c"}
    async with (
        running_bus(shared_router, site) as a,
        running_bus(shared_router, site) as b,
        running_bus(shared_router, site) as c,
        running_bus(shared_router, site) as late,
    ):
        for bus, name in zip((a, b, c), sorted(names), strict=True):
            bus.publish(ROBOT_CARD, ROBOT_CARD.model.model_validate({**example, "robot_id": name}), robot_id=name)
        async with late.subscribe(ROBOT_CARD) as cards:
            got = [await asyncio.wait_for(anext(cards), 120) for _ in names]
        async with late.subscribe(ROBOT_CARD, robot_id="robot_b") as cards:
            one = await asyncio.wait_for(anext(cards), 120)
    assert {r.ids["robot_id"] for r in got} == names
    assert one.ids == {"robot_id": "robot_b"}


async def test_a_retracted_value_is_gone_for_all(shared_router: RouterProcess, site: str) -> None:
    """A subscriber is told of the retraction; a late joiner hears nothing of the value or its end."""
    async with (
        running_bus(shared_router, site) as vision,
        running_bus(shared_router, site) as early,
        running_bus(shared_router, site) as late,
        early.subscribe(OBJECT) as messages,
    ):
        put(vision, "puddle1")
        vision.retract(OBJECT, object_name="puddle1")
        assert values(await take(messages, 2)) == [("puddle1", 1.0), ("puddle1", None)]
        async with late.subscribe(OBJECT) as late_messages:
            put(vision, "rock1")
            assert values(await take(late_messages, 1)) == [("rock1", 1.0)]


async def test_a_value_may_come_back_after_its_retraction(shared_router: RouterProcess, site: str) -> None:
    """Retracting is not for ever."""
    async with (
        running_bus(shared_router, site) as vision,
        running_bus(shared_router, site) as early,
        running_bus(shared_router, site) as late,
        early.subscribe(OBJECT) as early_messages,
    ):
        put(vision, "puddle1", 0.1)
        vision.retract(OBJECT, object_name="puddle1")
        put(vision, "puddle1", 0.7)
        await take(early_messages, 3)  # all of it has gone through the router
        async with late.subscribe(OBJECT) as messages:
            assert values(await take(messages, 1)) == [("puddle1", 0.7)]


async def test_joining_in_a_flood_loses_and_repeats_nothing(shared_router: RouterProcess, site: str) -> None:
    """A subscriber that joins while values stream in sees them grow, each once, up to the last one."""
    last = 2000

    def rules(revision: int) -> AreaRules:
        return AreaRules(revision=revision)

    async with running_bus(shared_router, site) as scheduler, running_bus(shared_router, site) as reader:

        async def flood() -> None:
            for revision in range(last + 1):
                scheduler.publish(AREAS, rules(revision))
                if revision % 20 == 0:
                    await asyncio.sleep(0)

        flooding = asyncio.create_task(flood())
        got: list[int] = []
        async with reader.subscribe(AREAS) as messages:
            async for received in messages:
                assert received.message is not None
                got.append(received.message.revision)
                if got[-1] == last:
                    break
        await flooding
    assert got == list(range(got[0], last + 1))


async def test_repeating_what_is_kept_is_no_news(shared_router: RouterProcess, site: str) -> None:
    """An owner repeats its values after an outage; who had them already hears nothing."""
    async with (
        running_bus(shared_router, site) as vision,
        running_bus(shared_router, site) as reader,
        reader.subscribe(OBJECT) as messages,
    ):
        put(vision, "puddle1", 0.1)
        put(vision, "puddle2", 0.2)
        vision.retract(OBJECT, object_name="puddle2")
        await take(messages, 3)
        kept: Any = vision._kept  # pyright: ignore[reportPrivateUsage]
        await kept.send_again()
        put(vision, "rock1", 0.3)
        assert values(await take(messages, 1)) == [("rock1", 0.3)]


async def test_the_next_life_of_an_owner_is_believed(shared_router: RouterProcess, site: str) -> None:
    """What a restarted owner says replaces what its earlier life said."""
    async with running_bus(shared_router, site) as reader, reader.subscribe(OBJECT) as messages:
        for confidence in (0.8, 0.4):
            async with running_bus(shared_router, site) as vision:
                put(vision, "puddle1", confidence)
                assert values(await take(messages, 1)) == [("puddle1", confidence)]


async def test_kept_values_can_be_read_by_any_zenoh_program(
    shared_router: RouterProcess, site: str, stranger: zenoh.Session
) -> None:
    """A plain query on everything gets the state that is there now."""
    async with running_bus(shared_router, site) as vision:
        put(vision, "puddle1")
        put(vision, "puddle2")

        async def keys() -> list[str]:
            replies = await asyncio.to_thread(
                lambda: list(stranger.get(all_of(site), target=zenoh.QueryTarget.ALL, timeout=60))
            )
            return sorted(str(r.ok.key_expr) for r in replies if r.ok)

        async def both() -> bool:
            return await keys() == [OBJECT.key(site=site, object_name=n) for n in ("puddle1", "puddle2")]

        await eventually(both)
