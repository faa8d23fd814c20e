"""Every channel of the table, over a real router."""

import asyncio
from typing import Any

import pytest
import zenoh
from muster_bus import NoReplyError, Received, WrongMessageError
from muster_bus.testing import RouterProcess, eventually, running_bus
from muster_schemas import channels
from muster_schemas.channels import CHANNELS, Channel, Kind
from muster_schemas.examples import EXAMPLES
from muster_schemas.ids import InvalidIdError
from muster_schemas.rpc import RulesQuery
from pydantic import BaseModel

MESSAGES = [c for c in CHANNELS if c.kind not in (Kind.QUERY, Kind.LIVELINESS)]
JPEG = b"\xff\xd8 not really a picture \xff\xd9"


def named(channel: Channel[Any]) -> str:
    """Name a test after its channel."""
    return channel.name


def publish_example(bus: Any, channel: Channel[Any]) -> None:
    """Send the channel's example message."""
    example = EXAMPLES[channel.name]
    if channel.binary:
        bus.publish_bytes(channel, JPEG, example.message, **example.ids)
    else:
        bus.publish(channel, example.message, **example.ids)


@pytest.mark.parametrize("channel", MESSAGES, ids=named)
async def test_a_published_message_arrives_whole(
    channel: Channel[BaseModel], shared_router: RouterProcess, site: str
) -> None:
    """What one process publishes, another receives as the same model with the ids of its key."""
    example = EXAMPLES[channel.name]
    async with (
        running_bus(shared_router, site) as sender,
        running_bus(shared_router, site) as reader,
        reader.subscribe(channel) as messages,
    ):
        publish_example(sender, channel)
        received = await asyncio.wait_for(anext(messages), 120)
    assert received == Received(example.message, example.ids, JPEG if channel.binary else b"")


@pytest.mark.parametrize("channel", [c for c in CHANNELS if c.kind is Kind.QUERY], ids=named)
async def test_a_request_is_answered(channel: Channel[BaseModel], shared_router: RouterProcess, site: str) -> None:
    """The handler gets the request as its model, the asker gets the reply as its model."""
    example = EXAMPLES[channel.name]
    requests: list[BaseModel] = []

    async def handle(request: BaseModel) -> BaseModel:
        requests.append(request)
        assert example.reply is not None
        return example.reply

    async with (
        running_bus(shared_router, site) as server,
        running_bus(shared_router, site) as asker,
        server.serve(channel, handle),
    ):
        reply = await asker.ask(channel, example.message, timeout_s=60)
    assert requests == [example.message]
    assert reply == example.reply


@pytest.mark.parametrize("channel", [c for c in CHANNELS if c.kind is Kind.LIVELINESS], ids=named)
async def test_a_token_is_seen_as_long_as_it_is_held(
    channel: Channel[BaseModel], shared_router: RouterProcess, site: str
) -> None:
    """A watcher sees a token come and go."""
    ids = {f: "a-1" for f in channel.fields if f != "site"}
    async with (
        running_bus(shared_router, site) as holder,
        running_bus(shared_router, site) as watcher,
        watcher.watch(channel) as changes,
    ):
        async with holder.alive(channel, **ids):
            came = await asyncio.wait_for(anext(changes), 120)
        went = await asyncio.wait_for(anext(changes), 120)
    assert (came.ids, came.alive) == (ids, True)
    assert (went.ids, went.alive) == (ids, False)


async def test_any_zenoh_subscriber_reads_json(
    shared_router: RouterProcess, site: str, stranger: zenoh.Session
) -> None:
    """A plain subscriber on everything sees each message as the JSON of its model under the table's key."""
    seen: dict[str, zenoh.Sample] = {}

    def note(sample: zenoh.Sample) -> None:
        seen[str(sample.key_expr)] = sample

    stranger.declare_subscriber(channels.all_of(site), note)
    async with running_bus(shared_router, site) as bus:

        def all_sent() -> bool:
            for channel in MESSAGES:
                publish_example(bus, channel)
            return len(seen) >= len(MESSAGES)

        await eventually(all_sent)
    for key, sample in seen.items():
        found = channels.find(key)
        assert found is not None
        channel = found[0]
        if channel.binary:
            assert sample.payload.to_bytes() == JPEG
            assert sample.attachment is not None
            text = sample.attachment.to_bytes()
        else:
            assert sample.encoding == zenoh.Encoding.APPLICATION_JSON
            text = sample.payload.to_bytes()
        assert channel.model.model_validate_json(text) == EXAMPLES[channel.name].message
    assert {c.name for key in seen if (f := channels.find(key)) for c in [f[0]]} == {c.name for c in MESSAGES}


async def test_a_subscriber_may_ask_for_some_ids_only(shared_router: RouterProcess, site: str) -> None:
    """Ids that a subscriber gives are kept to; those left out are free."""
    example = EXAMPLES["robot_state"].message
    async with (
        running_bus(shared_router, site) as bus,
        bus.subscribe(channels.ROBOT_STATE, robot_id="r2") as messages,
    ):
        for robot_id in ("r1", "r2"):
            state = channels.ROBOT_STATE.model.model_validate({**example.model_dump(), "robot_id": robot_id})
            bus.publish(channels.ROBOT_STATE, state, robot_id=robot_id)
        received = await asyncio.wait_for(anext(messages), 120)
    assert received.ids == {"robot_id": "r2"}


async def test_what_does_not_belong_on_a_channel_is_not_sent(shared_router: RouterProcess, site: str) -> None:
    """A wrong model, a missing, unknown, foreign or bad id, or the wrong kind of channel is the caller's mistake."""
    card, keywords = EXAMPLES["robot_card"].message, EXAMPLES["keywords"].message
    async with running_bus(shared_router, site) as bus:
        with pytest.raises(WrongMessageError, match="takes RobotCard, not Keywords"):
            bus.publish(channels.ROBOT_CARD, keywords, robot_id="r1")  # pyright: ignore[reportArgumentType]
        with pytest.raises(WrongMessageError, match="its key says 'r1'"):
            bus.publish(channels.ROBOT_CARD, card, robot_id="r1")  # pyright: ignore[reportArgumentType]
        with pytest.raises(TypeError, match="needs robot_id"):
            bus.publish(channels.ROBOT_CARD, card)  # pyright: ignore[reportArgumentType]
        with pytest.raises(TypeError, match="has no colour"):
            bus.publish(channels.ROBOT_CARD, card, robot_id="r1", colour="red")  # pyright: ignore[reportArgumentType]
        with pytest.raises(InvalidIdError):
            bus.publish(channels.ROBOT_CARD, card, robot_id="*")  # pyright: ignore[reportArgumentType]
        with pytest.raises(WrongMessageError, match="keeps no value"):
            bus.retract(channels.KEYWORDS)
        with pytest.raises(WrongMessageError, match="not bytes"):
            bus.publish_bytes(channels.KEYWORDS, b"", keywords)  # pyright: ignore[reportArgumentType]
        with pytest.raises(WrongMessageError, match="not one to subscribe to"):
            async with bus.subscribe(channels.MISSIONS):
                pass


async def test_after_the_end_nothing_is_sent_and_nothing_raises(shared_router: RouterProcess, site: str) -> None:
    """A task that outlives its bus by a moment does not turn an orderly end into a crash."""
    async with running_bus(shared_router, site) as bus:
        pass
    assert not bus.connected
    for channel in MESSAGES:
        publish_example(bus, channel)
    bus.retract(channels.OBJECT, object_name="soil1")
    with pytest.raises(NoReplyError, match="could not be asked"):
        await bus.ask(channels.RULES, RulesQuery())
