"""Whatever anybody puts on a key, no process ends, nothing reaches a service, and each piece is counted."""

# pyright: reportUnknownMemberType=false
# (Zenoh's stubs leave return types out.)

import asyncio
import json
from collections.abc import Iterator
from typing import Any

import pytest
import zenoh
from muster_bus import NoReplyError
from muster_bus.testing import RouterProcess, eventually, free_port, running_bus
from muster_bus.wire import size_limit
from muster_schemas.channels import CHANNELS, MISSIONS, ROBOT_STATE, Channel, Kind
from muster_schemas.examples import EXAMPLES
from muster_schemas.rpc import MissionsQuery, MissionsReply
from pydantic import BaseModel

MESSAGES = [c for c in CHANNELS if c.kind not in (Kind.QUERY, Kind.LIVELINESS)]
DEEP = b"[" * 20_000 + b"]" * 20_000
RUBBISH = [
    b"",
    b"null",
    b"[]",
    b"{",
    b"\xff\xfe\x00\x80",
    b'{"robot_id": "a", "robot_id": 1}',
    b'{"at": NaN, "x": 1e999, "seq": 9223372036854775808}',
    DEEP,
    bytes([0x80] * 7 + [0x01]),  # makes Zenoh's own deserializer abort the process
]


def named(channel: Channel[Any]) -> str:
    """Name a test after its channel."""
    return channel.name


def wrong_puts(channel: Channel[Any], site: str) -> Iterator[tuple[str, bytes, str]]:
    """Yield (key, JSON, encoding) of puts that no reader may see."""
    example = EXAMPLES[channel.name]
    key = channel.key(site=site, **example.ids)
    good = example.message.model_dump_json(by_alias=True).encode()
    encoding = "image/jpeg" if channel.binary else "application/json"
    for rubbish in RUBBISH:
        yield key, rubbish, encoding
    yield key, good, "text/plain"
    for field in example.ids:
        others = {k: v for k, v in example.ids.items() if k != field}
        yield channel.key(site=site, **others), good, encoding  # onto a wildcard
        if hasattr(example.message, field):
            yield channel.key(site=site, **others, **{field: "somebody-else"}), good, encoding


@pytest.mark.parametrize("channel", MESSAGES, ids=named)
async def test_rubbish_is_counted_and_does_not_come_through(
    channel: Channel[BaseModel], shared_router: RouterProcess, site: str, stranger: zenoh.Session
) -> None:
    """After every kind of rubbish the next good message comes through, and each piece of rubbish was counted."""

    def put(key: str, text: bytes, encoding: str) -> None:
        payload, attachment = (b"picture", text) if channel.binary else (text, None)
        stranger.put(
            key,
            payload,
            attachment=attachment,
            encoding=encoding,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    async with running_bus(shared_router, site) as bus, bus.subscribe(channel) as messages:
        reading = asyncio.ensure_future(anext(messages))
        for count, wrong in enumerate(wrong_puts(channel, site), start=1):
            put(*wrong)
            await eventually(lambda expected=count: bus.rejected[channel.name] == expected)
        example = EXAMPLES[channel.name]
        good = example.message.model_dump_json(by_alias=True).encode()
        put(channel.key(site=site, **example.ids), good, "image/jpeg" if channel.binary else "application/json")
        received = await asyncio.wait_for(reading, 120)
    assert (received.message, received.ids) == (example.message, example.ids)


async def test_a_delete_on_a_stream_is_counted(
    shared_router: RouterProcess, site: str, stranger: zenoh.Session
) -> None:
    """Only state channels have values that can be deleted."""
    async with running_bus(shared_router, site) as bus, bus.subscribe(ROBOT_STATE) as messages:
        reading = asyncio.ensure_future(anext(messages))
        stranger.delete(ROBOT_STATE.key(site=site, robot_id="robot_a"))
        await eventually(lambda: bus.rejected["robot_state"] == 1)
        assert not reading.done()
        reading.cancel()


@pytest.mark.parametrize("channel", MESSAGES, ids=named)
async def test_the_router_turns_away_what_is_too_big(
    channel: Channel[BaseModel], shared_router: RouterProcess, site: str, stranger: zenoh.Session
) -> None:
    """A put above its channel's limit goes no further than the router; one at the limit does."""
    key = channel.key(site=site, **EXAMPLES[channel.name].ids)
    sizes: list[int] = []

    def note(sample: zenoh.Sample) -> None:
        sizes.append(len(sample.payload))

    with zenoh.open(_config(shared_router.endpoint)) as listener:
        listener.declare_subscriber(key, note)

        def listening() -> bool:
            stranger.put(key, b"?")
            return bool(sizes)

        await eventually(listening)
        limit = size_limit(channel)
        for size in (limit + 1, limit):
            stranger.put(key, bytes(size), congestion_control=zenoh.CongestionControl.BLOCK)
        await eventually(lambda: max(sizes) >= limit)
    assert max(sizes) == limit


async def test_readers_turn_away_what_is_too_big_themselves(site: str) -> None:
    """Behind a router that lets everything through, a reader still takes nothing above the limit."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = RouterProcess()
    router.endpoint = endpoint
    with zenoh.open(_config(endpoint, router=True)):
        async with running_bus(router, site) as bus, bus.subscribe(ROBOT_STATE) as messages:
            reading = asyncio.ensure_future(anext(messages))
            with zenoh.open(_config(endpoint)) as stranger:
                stranger.put(
                    ROBOT_STATE.key(site=site, robot_id="robot_a"),
                    b" " * (size_limit(ROBOT_STATE) + 1),
                    encoding="application/json",
                    congestion_control=zenoh.CongestionControl.BLOCK,
                )
                await eventually(lambda: bus.rejected["robot_state"] == 1)
            assert not reading.done()
            reading.cancel()


async def test_rubbish_requests_are_refused(shared_router: RouterProcess, site: str, stranger: zenoh.Session) -> None:
    """A malformed request gets an error reply and never reaches the handler; the next good one is served."""
    handled: list[MissionsQuery] = []

    async def handle(request: MissionsQuery) -> MissionsReply:
        handled.append(request)
        return MissionsReply(missions=())

    def ask_rubbish(payload: bytes | None, encoding: str) -> list[zenoh.Reply]:
        return list(stranger.get(MISSIONS.key(site=site), payload=payload, encoding=encoding, timeout=60))

    async with running_bus(shared_router, site) as bus, bus.serve(MISSIONS, handle):
        texts = [text for text in RUBBISH if not text.startswith(b'{"')] + [b'{"limit": NaN}', b'{"limit": 1e999}']
        rubbish = [*((text, "application/json") for text in texts if text), (b"{}", "text/plain"), (None, "")]
        for count, (payload, encoding) in enumerate(rubbish, start=1):
            replies = await asyncio.to_thread(ask_rubbish, payload, encoding)
            assert len(replies) == 1
            error = replies[0].err
            assert error is not None
            assert json.loads(error.payload.to_bytes())["code"] == "invalid"
            assert bus.rejected["missions"] == count
        assert handled == []
        await bus.ask(MISSIONS, MissionsQuery(), timeout_s=60)
        assert handled == [MissionsQuery()]


async def test_rubbish_replies_are_no_replies(shared_router: RouterProcess, site: str, stranger: zenoh.Session) -> None:
    """An asker never gets anything but the reply model: a reply that is none counts as unknown."""
    replies = iter([b"", b"\xff", b'{"missions": 1}', DEEP])

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(MISSIONS.key(site=site), next(replies), encoding="application/json")

    queryable = stranger.declare_queryable(MISSIONS.key(site=site), answer, complete=True)
    async with running_bus(shared_router, site) as bus:
        for _ in range(4):
            with pytest.raises(NoReplyError, match="makes no sense"):
                await bus.ask(MISSIONS, MissionsQuery(), timeout_s=60)
        assert bus.rejected["missions"] == 4
    queryable.undeclare()


async def test_an_error_reply_in_no_form_is_no_reply(
    shared_router: RouterProcess, site: str, stranger: zenoh.Session
) -> None:
    """Only an `ErrorReply` says that nothing has changed; any other error leaves that open."""

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply_err(b"oops")

    queryable = stranger.declare_queryable(MISSIONS.key(site=site), answer, complete=True)
    async with running_bus(shared_router, site) as bus:
        with pytest.raises(NoReplyError):
            await bus.ask(MISSIONS, MissionsQuery(), timeout_s=60)
    queryable.undeclare()


def _config(endpoint: str, *, router: bool = False) -> zenoh.Config:
    settings = {
        "mode": "router" if router else "client",
        "listen" if router else "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}},
    }
    return zenoh.Config.from_json5(json.dumps(settings))
