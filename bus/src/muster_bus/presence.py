"""Liveliness: who has a link to the site. Whether the process still works, only its own messages tell."""

# pyright: reportUnknownMemberType=false
# (Zenoh's stubs leave return types out.)

import asyncio
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import zenoh
from muster_schemas.channels import Channel

from .inbox import Inbox, InboxClosedError, call_in
from .rejects import Rejects

_ROUND_TRIP_S = 5.0


@dataclass(frozen=True, slots=True)
class Presence:
    """Someone came or went. When the own link is lost, everybody goes: look at `Bus.connected`."""

    ids: dict[str, str]
    """The ids in the token's key, without the site."""
    alive: bool


class Watch:
    """`async with` it, then `async for`: first everybody who is there now."""

    def __init__(
        self, session: zenoh.Session, channel: Channel[Any], site: str, ids: dict[str, str], rejects: Rejects
    ) -> None:
        self._session = session
        self._channel = channel
        self._key = channel.key(site=site, **ids)
        self._rejects = rejects

    async def __aenter__(self) -> Self:
        self._inbox: Inbox[zenoh.Sample] = Inbox(by_key=True)
        inbox = self._inbox

        def enqueue(sample: zenoh.Sample) -> None:
            inbox.put(str(sample.key_expr), sample)

        callback = zenoh.handlers.Callback(enqueue, indirect=False)
        self._subscriber = self._session.liveliness().declare_subscriber(self._key, callback, history=True)
        await settled(self._session, self._key)  # the current set is in the inbox now
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._subscriber.undeclare()
        self._inbox.close()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Presence:
        while True:
            try:
                sample = await self._inbox.get()
            except InboxClosedError:
                raise StopAsyncIteration from None
            ids = self._channel.ids(str(sample.key_expr))
            if ids is None:
                self._rejects.count(self._channel.name, str(sample.key_expr), "its key holds something that is no id")
                continue
            ids.pop("site")
            return Presence(ids, sample.kind == zenoh.SampleKind.PUT)


async def tokens(session: zenoh.Session, key: str, *, timeout_s: float) -> list[str]:
    """Return the keys of the tokens that are there now; none if the own link is down."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()
    keys: list[str] = []

    def on_reply(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            keys.append(str(reply.ok.key_expr))

    def finish() -> None:
        if not done.done():
            done.set_result(None)

    def on_end() -> None:
        call_in(loop, finish)

    session.liveliness().get(key, zenoh.handlers.Callback(on_reply, drop=on_end, indirect=False), timeout=timeout_s)
    await done
    return keys


async def settled(session: zenoh.Session, key: str) -> None:
    """Wait until the router has taken in what was declared before (at once if the link is down).

    Zenoh declares without waiting; whoever published right after that could be missed. The router works off a link in
    order, so its answer to anything asked later says that the declaration is in force.
    """
    await tokens(session, key, timeout_s=_ROUND_TRIP_S)
