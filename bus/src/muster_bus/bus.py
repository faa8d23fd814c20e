"""`Bus`: what a service sees of the site. Keys and sites are filled in here, bad messages are dropped here."""

# Zenoh's stubs leave return types out.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false, reportUnknownArgumentType=false

import asyncio
import contextlib
import time
from collections import Counter
from collections.abc import AsyncGenerator, Generator, Sequence
from typing import Any, Final, TypeVar

import structlog
import zenoh
from muster_schemas.channels import Channel, Kind
from muster_schemas.ids import check_id, new_boot_id
from pydantic import BaseModel

from .calls import Handler, Server, ask
from .errors import WrongMessageError
from .inbox import call_in
from .kept import KeptValues
from .presence import Watch, settled, tokens
from .rejects import Rejects
from .session import connect as connect_session
from .subscription import Subscription
from .wire import JPEG, JSON, checked_size, concrete_key, encode

M = TypeVar("M", bound=BaseModel)

_log = structlog.stdlib.get_logger(__name__)

_ROUNDS_S = (0.0, 0.3, 1.5)
"""When, after the link came back, state is sent and fetched again: the others' links come back at other moments."""

_WHO_S: Final = 1.0

_LINK_S: Final = 0.05
"""How old the answer may be to whether the link is up; hundreds of agents of one process ask ten times a second."""

_HOW: Final = {
    Kind.COMMAND: (zenoh.CongestionControl.BLOCK, zenoh.Priority.INTERACTIVE_HIGH),
    Kind.EVENT: (zenoh.CongestionControl.BLOCK, zenoh.Priority.INTERACTIVE_HIGH),
    Kind.STREAM: (zenoh.CongestionControl.DROP, zenoh.Priority.DATA),
}
"""Of puts, by kind; state channels have theirs in `kept`. Large images must not stand before a command."""


class Bus:
    """One process's place on the bus of one site; get one from `open_bus` or `runtime.run`."""

    def __init__(self, session: zenoh.Session, site: str, boot_id: str) -> None:
        self._session = session
        self.site: Final = site
        self.boot_id: Final = boot_id
        """The id of this life of the process."""
        self._rejects = Rejects()
        self._kept = KeptValues(session, site)
        self._subscriptions: set[Subscription[Any]] = set()
        self._closed = False
        self._link_is_up = False
        self._link_looked_at = float("-inf")

    @property
    def connected(self) -> bool:
        """Whether the own link to a router is up; if not, nobody else's absence means anything."""
        # Not `session.is_closed()`: it waits for the session's lock while it holds the interpreter's. A receiving
        # thread that drops a callback holds the first and waits for the second, so the process would hang for ever.
        now = time.monotonic()
        if now - self._link_looked_at >= _LINK_S:
            self._link_looked_at = now
            self._link_is_up = bool(self._session.info.routers_zid())
        return self._link_is_up and not self._closed

    @property
    def rejected(self) -> Counter[str]:
        """How many messages were turned away as malformed, by channel name."""
        return self._rejects.counts

    def publish(self, channel: Channel[M], message: M, **ids: str) -> None:
        """Send a message; cheap, from any thread. While the link is down it is lost, except on state channels.

        Raises:
            TypeError: an id is missing or unknown, or the channel is binary or no channel to publish on.
            InvalidIdError: an id has characters that a key may not have.
            WrongMessageError: the message is not the channel's, or says other ids.
            TooBigError: it is larger than the channel allows.

        """
        key = concrete_key(channel, self.site, ids)
        if channel.binary or channel.kind in (Kind.QUERY, Kind.LIVELINESS):
            raise WrongMessageError(f"channel {channel.name} is not one to publish a message on")
        payload = encode(channel, message, ids)
        with self._sending(channel):
            if channel.kind is Kind.STATE:
                self._kept.put(channel, key, payload)
            else:
                control, priority = _HOW[channel.kind]
                self._session.put(key, payload, encoding=JSON, congestion_control=control, priority=priority)

    def publish_bytes(self, channel: Channel[M], payload: bytes, meta: M, **ids: str) -> None:
        """Send bytes on a binary channel, with `meta` as the attachment; raises what `publish` raises."""
        key = concrete_key(channel, self.site, ids)
        if not channel.binary:
            raise WrongMessageError(f"channel {channel.name} takes a {channel.model.__name__}, not bytes")
        attachment = encode(channel, meta, ids)
        with self._sending(channel):
            self._session.put(
                key,
                checked_size(channel, payload),
                encoding=JPEG,
                attachment=attachment,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA_LOW,
            )

    def retract(self, channel: Channel[Any], **ids: str) -> None:
        """Take back the value of a state channel's key; subscribers receive `message=None`."""
        if channel.kind is not Kind.STATE:
            raise WrongMessageError(f"channel {channel.name} keeps no value")
        key = concrete_key(channel, self.site, ids)
        with self._sending(channel):
            self._kept.delete(channel, key)

    @contextlib.asynccontextmanager
    async def subscribe(self, channel: Channel[M], **ids: str) -> AsyncGenerator[Subscription[M]]:
        """Subscribe to all keys with these ids, the others free; state channels begin with the current values."""
        if channel.kind in (Kind.QUERY, Kind.LIVELINESS):
            raise WrongMessageError(f"channel {channel.name} is not one to subscribe to")
        async with Subscription(self._session, channel, self.site, ids, self._rejects) as subscription:
            self._subscriptions.add(subscription)
            try:
                yield subscription
            finally:
                self._subscriptions.discard(subscription)

    def serve(self, channel: Channel[M], handler: Handler[M]) -> Server[M]:
        """Answer the requests of a channel while the returned context is entered.

        The handler may raise `Refusal`; whatever else it raises is logged and answered as an internal error.
        """
        return Server(self._session, channel, self.site, handler, self._rejects)

    async def ask(self, channel: Channel[M], request: M, timeout_s: float = 2.0) -> Any:
        """Send a request and return the reply (of the channel's `reply` model).

        Raises:
            NoReplyError: nobody answered in time; whether it ran is not known.
            RefusedError: the other side refused; nothing has changed.
            WrongMessageError, TooBigError: the request is not the channel's, or too large.

        """
        return await ask(self._session, channel, self.site, request, self._rejects, timeout_s)

    @contextlib.asynccontextmanager
    async def alive(self, channel: Channel[Any], **ids: str) -> AsyncGenerator[None]:
        """Hold a liveliness token while entered."""
        key = concrete_key(channel, self.site, ids)
        token = self._session.liveliness().declare_token(key)
        await settled(self._session, key)
        try:
            yield
        finally:
            token.undeclare()

    def watch(self, channel: Channel[Any], **ids: str) -> Watch:
        """Follow who comes and goes, beginning with who is there."""
        return Watch(self._session, channel, self.site, ids, self._rejects)

    async def who_is_alive(self, channel: Channel[Any], **ids: str) -> list[dict[str, str]]:
        """Return the ids of the tokens that are there now; none while the own link is down."""
        keys = await tokens(self._session, channel.key(site=self.site, **ids), timeout_s=_WHO_S)
        found = [channel.ids(key) for key in keys]
        return [{k: v for k, v in f.items() if k != "site"} for f in found if f is not None]

    async def run(self) -> None:
        """Do the bus's own work until cancelled: answer for kept values, mend state after an outage."""
        loop = asyncio.get_running_loop()
        link_up = asyncio.Event()

        def on_event(event: zenoh.TransportEvent) -> None:
            up = event.kind == zenoh.SampleKind.PUT
            call_in(loop, link_up.set if up else link_up.clear)
            call_in(loop, lambda: _log.info("link_up" if up else "link_down"))

        callback = zenoh.handlers.Callback(on_event, indirect=False)
        listener = self._session.info.declare_transport_events_listener(callback)
        answering = asyncio.create_task(self._kept.answer(), name="answer for kept values")
        try:
            while True:
                await link_up.wait()
                link_up.clear()
                try:
                    await self._mend()
                except zenoh.ZError as error:  # the link went again; its return mends
                    _log.warning("not_mended", error=str(error)[:200])
        finally:
            answering.cancel()
            listener.undeclare()

    @contextlib.contextmanager
    def _sending(self, channel: Channel[Any]) -> Generator[None]:
        """Take a put that Zenoh refuses (the session is closed) for one that was lost on its way."""
        try:
            yield
        except zenoh.ZError as error:
            _log.warning("not_sent", channel=channel.name, error=str(error)[:200])

    async def _mend(self) -> None:
        waited = 0.0
        for at_s in _ROUNDS_S:
            await asyncio.sleep(at_s - waited)
            waited = at_s
            await self._kept.send_again()
            for subscription in tuple(self._subscriptions):
                subscription.refresh()

    async def close(self) -> None:
        """Close the session; may take as long as the link hangs."""
        self._closed = True
        await asyncio.to_thread(self._session.close)


@contextlib.asynccontextmanager
async def open_bus(site: str, connect: Sequence[str], *, boot_id: str | None = None) -> AsyncGenerator[Bus]:
    """Connect to the first router that answers, waiting for one as long as it takes, and close at the end.

    Args:
        site: the site's name.
        connect: endpoints such as "tcp/127.0.0.1:7447".
        boot_id: of this life of the process; a new one if left out.

    """
    check_id(site, "site")
    session = await connect_session(connect)
    bus = Bus(session, site, boot_id or new_boot_id())
    running = asyncio.create_task(bus.run(), name="bus")
    try:
        yield bus
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        await bus.close()
