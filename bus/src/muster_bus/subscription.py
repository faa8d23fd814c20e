"""The reader's side: typed messages of a channel, and for state channels the current values first.

A subscriber of a state channel subscribes, then asks the owners, so nothing falls between; live and fetched values meet
in one queue and are told apart by their Zenoh timestamps. It asks again whenever the link to the router comes back.
"""

# pyright: reportUnknownMemberType=false
# (Zenoh's stubs leave return types out.)

import asyncio
import contextlib
from dataclasses import dataclass
from types import TracebackType
from typing import Generic, Self, TypeVar

import structlog
import zenoh
from muster_schemas.channels import Channel, Kind
from pydantic import BaseModel

from .inbox import Inbox, InboxClosedError, call_in
from .presence import settled
from .rejects import Rejects
from .wire import MalformedError, decode_sample

M = TypeVar("M", bound=BaseModel)

_log = structlog.stdlib.get_logger(__name__)

_FETCH_TIMEOUT_S = 2.0
_FIRST_FETCH_S = 1.0
"""How long entering a state subscription waits for the current values before it goes on without the rest."""


@dataclass(frozen=True, slots=True)
class Received(Generic[M]):
    """One message."""

    message: M | None
    """None: the value was retracted (state channels only)."""
    ids: dict[str, str]
    """The ids in its key, without the site."""
    payload: bytes = b""
    """Of a binary channel; `message` is then its attachment."""


class Subscription(Generic[M]):
    """`async with` it, then `async for`. One reader each."""

    def __init__(
        self, session: zenoh.Session, channel: Channel[M], site: str, ids: dict[str, str], rejects: Rejects
    ) -> None:
        self._session = session
        self._channel = channel
        self._key = channel.key(site=site, **ids)
        self._rejects = rejects
        self._order = _Order()
        self._subscriber: zenoh.Subscriber[None] | None = None
        self._fetching: asyncio.Task[None] | None = None
        self._overflow_logged = 0

    async def __aenter__(self) -> Self:
        kind = self._channel.kind
        self._inbox: Inbox[tuple[zenoh.Sample, bool]] = Inbox(
            newest_only=kind is Kind.STREAM, by_key=kind is Kind.STATE
        )
        inbox = self._inbox

        def enqueue(sample: zenoh.Sample) -> None:
            inbox.put(str(sample.key_expr), (sample, False))

        callback = zenoh.handlers.Callback(enqueue, indirect=False)
        self._subscriber = self._session.declare_subscriber(self._key, callback)
        if kind is Kind.STATE:
            self.refresh()
            assert self._fetching is not None  # noqa: S101  (refresh has just set it)
            await asyncio.wait((self._fetching,), timeout=_FIRST_FETCH_S)
        else:
            await settled(self._session, self._key)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._fetching is not None:
            self._fetching.cancel()
        if self._subscriber is not None:
            self._subscriber.undeclare()
            self._subscriber = None
        self._inbox.close()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Received[M]:
        while True:
            try:
                sample, fetched = await self._inbox.get()
            except InboxClosedError:
                raise StopAsyncIteration from None
            if self._inbox.overflowed > self._overflow_logged:
                self._overflow_logged = self._inbox.overflowed
                _log.error("reader_too_slow", channel=self._channel.name, lost=self._overflow_logged)
            received = self._receive(sample, fetched=fetched)
            if received is not None:
                return received

    def refresh(self) -> None:
        """Ask the owners of a state channel for what they keep; does nothing for other kinds."""
        if self._channel.kind is not Kind.STATE or self._subscriber is None:
            return
        if self._fetching is not None:
            self._fetching.cancel()
        self._fetching = asyncio.create_task(self._fetch(), name=f"fetch {self._key}")

    def _receive(self, sample: zenoh.Sample, *, fetched: bool) -> Received[M] | None:
        """Return the message, or None if it is malformed or old news."""
        key = str(sample.key_expr)
        ids = self._channel.ids(key)
        if ids is None:
            self._rejects.count(self._channel.name, key, "its key holds something that is no id")
            return None
        ids.pop("site")
        deleted = sample.kind == zenoh.SampleKind.DELETE
        if self._channel.kind is not Kind.STATE:
            if deleted:
                self._rejects.count(self._channel.name, key, "a delete means nothing on this channel")
                return None
        elif not self._order.is_news(key, sample, fetched=fetched):
            return None
        if deleted:
            return Received(None, ids) if self._order.accept(key, sample, fetched=fetched) or not fetched else None
        try:
            message, payload = decode_sample(self._channel, ids, sample)
        except MalformedError as error:
            self._rejects.count(self._channel.name, key, str(error))
            return None
        self._order.accept(key, sample, fetched=fetched)
        return Received(message, ids, payload)

    async def _fetch(self) -> None:
        """Fetch once, and again as long as an owner does not answer in time."""
        with contextlib.suppress(zenoh.ZError):  # the session is closed
            complete = await self._fetch_once()
            while not complete:
                await asyncio.sleep(_FETCH_TIMEOUT_S)
                complete = await self._fetch_once()

    async def _fetch_once(self) -> bool:
        loop = asyncio.get_running_loop()
        done: asyncio.Future[None] = loop.create_future()
        inbox, failed = self._inbox, list[zenoh.Reply]()

        def finish() -> None:
            if not done.done():
                done.set_result(None)

        def on_reply(reply: zenoh.Reply) -> None:
            sample = reply.ok
            if sample is None:
                failed.append(reply)
            else:
                # Its own key, because arriving later does not make it newer than a live one.
                inbox.put(f"?{sample.key_expr}", (sample, True))

        def on_end() -> None:
            call_in(loop, finish)

        self._order.fetch_begins()
        cancel = zenoh.CancellationToken()
        self._session.get(
            self._key,
            zenoh.handlers.Callback(on_reply, drop=on_end, indirect=False),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_FETCH_TIMEOUT_S,
            cancellation_token=cancel,
        )
        try:
            await done
        except asyncio.CancelledError:
            cancel.cancel()
            raise
        return not failed


class _Order:
    """Which values are news: none twice, none after a newer one of the same key.

    Stamps of one session grow, whatever the wall clock does. Stamps of two sessions (an owner and its next life)
    compare only as well as their clocks; a live value of another session is always news, and a fetched one is if
    nothing came live since it was asked for.
    """

    def __init__(self) -> None:
        self._last: dict[str, zenoh.Timestamp] = {}
        self._live_since_fetch: set[str] = set()

    def fetch_begins(self) -> None:
        self._live_since_fetch.clear()

    def is_news(self, key: str, sample: zenoh.Sample, *, fetched: bool) -> bool:
        last, stamp = self._last.get(key), sample.timestamp
        if last is None:
            return not fetched or key not in self._live_since_fetch
        if stamp is None:
            return not fetched
        if stamp.get_id() == last.get_id():
            return not last >= stamp
        return not fetched or key not in self._live_since_fetch or not last >= stamp

    def accept(self, key: str, sample: zenoh.Sample, *, fetched: bool) -> bool:
        """Remember it; return whether the key had a value before."""
        known = key in self._last or key in self._live_since_fetch
        if sample.timestamp is not None:
            self._last[key] = sample.timestamp
        if not fetched:
            self._live_since_fetch.add(key)
        return known
