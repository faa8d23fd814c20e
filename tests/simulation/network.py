"""The faulty bus: what a service sees as `Bus`, with a network behind it that a script may spoil.

Between two processes stands a router, as on a real site. A process may be cut off from it one way or both; messages may
be lost, doubled or held up, so that they come late and in another order. State channels mend themselves when trouble
ends, liveliness follows the links, and a request that is not answered in time may have run: as `bus/` behaves.
"""

import asyncio
import contextlib
import math
import random
from collections import Counter
from collections.abc import AsyncGenerator, Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any

import structlog
from muster_bus import NoReplyError, Presence, Refusal, RefusedError
from muster_schemas.channels import ROBOT_STATE, Channel, Kind
from pydantic import BaseModel

from .streams import Reader, Stream, Value, Watcher
from .virtual import Killed

_log = structlog.stdlib.get_logger(__name__)
LEASE_S = 2.0
"""After this long a link that carries nothing counts as lost."""
HOP_S = 0.001
MEND_S = (0.0, 0.3, 1.5)

Handler = Callable[[Any], Awaitable[BaseModel]]


@dataclass
class Asked:
    """A request on its way through a server."""

    request: BaseModel
    answer: Callable[["BaseModel | Refusal"], None]


@dataclass
class Noise:
    """What the network does to single messages now."""

    drop: float = 0.0
    double: float = 0.0
    late: float = 0.0
    """The share of messages that are held up."""
    late_s: float = 0.0
    """For at most this long."""


@dataclass
class Link:
    """A process's way to the router."""

    out: bool = True
    into: bool = True
    held: bool = False
    """While it is cut, messages wait in place of being lost."""
    lost: bool = False
    """Both sides have noticed."""
    waiting: list[Callable[[], None]] = field(default_factory=list[Callable[[], None]])


Listener = Callable[["SimulatedBus", Channel[Any], BaseModel], None]


def _nobody(_bus: "SimulatedBus", _channel: Channel[Any], _message: BaseModel) -> None:
    """Listen to nothing."""


class Network:
    """The router and all links."""

    def __init__(self, rng: random.Random, site: str) -> None:
        self.site = site
        self.noise = Noise()
        self.buses: list[SimulatedBus] = []
        self.delivered: Listener = _nobody
        """Told of each message that reaches a process."""
        self.sent: Listener = _nobody
        self._rng = rng
        self._stamp = 0

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """The run's loop."""
        return asyncio.get_running_loop()

    def stamp(self) -> int:
        """Return the next stamp of a kept value."""
        self._stamp += 1
        return self._stamp

    def carry(self, source: "SimulatedBus", target: "SimulatedBus", deliver: Callable[[], None]) -> None:
        """Take one message from a process to another, as well as the network can now."""
        noise = self.noise
        copies = 0 if noise.drop and self._rng.random() < noise.drop else 1
        if copies and noise.double and self._rng.random() < noise.double:
            copies = 2
        for _ in range(copies):
            wait = HOP_S
            if noise.late and self._rng.random() < noise.late:
                wait += self._rng.uniform(0, noise.late_s)
            self._leave(source, target, deliver, wait)

    def _leave(self, source: "SimulatedBus", target: "SimulatedBus", deliver: Callable[[], None], wait: float) -> None:
        if source is not target and not source.link.out:
            if source.link.held and not source.link.lost:
                source.link.waiting.append(lambda: self._leave(source, target, deliver, wait))
            return
        self.loop.call_later(wait, self._arrive, source, target, deliver, self.loop.time())

    def _arrive(
        self, source: "SimulatedBus", target: "SimulatedBus", deliver: Callable[[], None], sent_at: float
    ) -> None:
        if target.dead or sent_at >= source.mute_since:
            return
        if source is not target and not target.link.into:
            if target.link.held and not target.link.lost:
                target.link.waiting.append(lambda: self._arrive(source, target, deliver, sent_at))
            return
        deliver()

    def cut(self, bus: "SimulatedBus", *, out: bool, into: bool, held: bool, noticed: bool) -> None:
        """Cut a process off, one way or both."""
        bus.link = Link(out=not out, into=not into, held=held)
        link = bus.link

        def lose() -> None:
            if bus.link is link:
                link.lost = True
                link.waiting.clear()
                self.tokens_changed()

        self.loop.call_later(0.0 if noticed else LEASE_S, lose)

    def heal(self, bus: "SimulatedBus") -> None:
        """Give a process its way to the router back."""
        before, bus.link = bus.link, Link()
        for deliver in before.waiting:
            deliver()
        self.tokens_changed()
        self.mend(bus)

    def mend(self, bus: "SimulatedBus") -> None:
        """Send and fetch kept values again, as a bus does after its link came back."""
        for wait in MEND_S:
            self.loop.call_later(wait, self._mend, bus)

    def _mend(self, bus: "SimulatedBus") -> None:
        if bus.dead:
            return
        bus.send_kept()
        for reader in tuple(bus.readers):
            bus.fetch(reader)

    def tokens_changed(self) -> None:
        """Let every watcher learn who is there for it now."""
        for bus in self.buses:
            for watcher in tuple(bus.watchers):
                there = {
                    (other.boot_id, *ids.values()): ids
                    for other in self.buses
                    for channel, ids in other.tokens
                    if channel is watcher.channel and all(ids.get(k) == v for k, v in watcher.wanted.items())
                    if other is bus or not (other.link.lost or bus.link.lost)
                }
                for key in [k for k in watcher.seen if k not in there]:
                    self._tell(watcher, Presence(watcher.seen.pop(key), alive=False))
                for key in [k for k in there if k not in watcher.seen]:
                    watcher.seen[key] = there[key]
                    self._tell(watcher, Presence(there[key], alive=True))

    def _tell(self, watcher: Watcher, change: Presence) -> None:
        self.loop.call_later(2 * HOP_S, watcher.put, change)

    def server(self, channel: Channel[Any]) -> "tuple[SimulatedBus, Stream[Asked]] | None":
        """Return who answers a channel's requests."""
        for bus in self.buses:
            if channel.name in bus.servers:
                return bus, bus.servers[channel.name]
        return None


class SimulatedBus:
    """One life of one process on the network; as `muster_bus.Bus`, as far as scheduler and agents need it."""

    def __init__(self, network: Network, name: str, boot_id: str) -> None:
        self.network = network
        self.name = name
        self.boot_id = boot_id
        self.site = network.site
        self.rejected: Counter[str] = Counter()
        self.link = Link()
        self.dead = False
        self.mute_since = math.inf
        """What was sent after this never left the process."""
        self.readers: list[Reader] = []
        self.watchers: list[Watcher] = []
        self.tokens: list[tuple[Channel[Any], dict[str, str]]] = []
        self.servers: dict[str, Stream[Asked]] = {}
        self.kept: dict[str, tuple[Channel[Any], dict[str, str], Value]] = {}
        network.buses.append(self)

    @property
    def connected(self) -> bool:
        """Whether this process believes that it has a link."""
        return not self.dead and not self.link.lost

    def die(self, *, mute: bool) -> None:
        """Say nothing more: the process is gone; with `mute` what it has just said is lost with it."""
        self.dead = True
        self.mute_since = self.network.loop.time() - HOP_S if mute else math.inf
        self.tokens.clear()
        self.servers.clear()
        self.network.buses.remove(self)
        self.network.tokens_changed()

    def publish(self, channel: Channel[Any], message: BaseModel, **ids: str) -> None:
        """Send a message, or lose it."""
        if not self.dead:
            self.network.sent(self, channel, message)
            self._send(channel, ids, (self.network.stamp(), message))

    def retract(self, channel: Channel[Any], **ids: str) -> None:
        """Take a kept value back."""
        if not self.dead:
            self._send(channel, ids, (self.network.stamp(), None))

    def _send(self, channel: Channel[Any], ids: dict[str, str], value: Value) -> None:
        if channel.kind is Kind.STATE:
            self.kept[channel.key(**ids)] = (channel, ids, value)
        for bus in tuple(self.network.buses):
            for reader in bus.readers:
                # where other robots are matters only to driving, which is not simulated here
                if reader.matches(channel, ids) and (channel is not ROBOT_STATE or bus.name == "scheduler"):
                    self._hand_over(bus, reader, channel, ids, value)

    def _hand_over(
        self, bus: "SimulatedBus", reader: Reader, channel: Channel[Any], ids: dict[str, str], value: Value
    ) -> None:
        def deliver() -> None:
            if value[1] is not None and channel is not ROBOT_STATE:
                self.network.delivered(bus, channel, value[1])
            reader.take(ids, value)

        self.network.carry(self, bus, deliver)

    def send_kept(self) -> None:
        """Send every kept value again."""
        for channel, ids, value in tuple(self.kept.values()):
            self._send(channel, ids, value)

    def fetch(self, reader: Reader) -> None:
        """Ask the owners for what they keep."""
        if reader.channel.kind is Kind.STATE:
            for bus in tuple(self.network.buses):
                for channel, ids, value in tuple(bus.kept.values()):
                    if reader.matches(channel, ids):
                        bus._hand_over(self, reader, channel, ids, value)

    @contextlib.asynccontextmanager
    async def subscribe(self, channel: Channel[Any], **ids: str) -> AsyncGenerator[Reader]:
        """Read a channel's messages while entered."""
        reader = Reader(channel, ids)
        self.readers.append(reader)
        self.fetch(reader)
        await asyncio.sleep(4 * HOP_S)
        try:
            yield reader
        finally:
            self.readers.remove(reader)
            reader.close()

    @contextlib.asynccontextmanager
    async def watch(self, channel: Channel[Any], **ids: str) -> AsyncGenerator[Watcher]:
        """Follow tokens while entered."""
        watcher = Watcher(channel, ids)
        self.watchers.append(watcher)
        self.network.tokens_changed()
        await asyncio.sleep(4 * HOP_S)
        try:
            yield watcher
        finally:
            self.watchers.remove(watcher)
            watcher.close()

    @contextlib.asynccontextmanager
    async def alive(self, channel: Channel[Any], **ids: str) -> AsyncGenerator[None]:
        """Hold a token while entered."""
        token = (channel, ids)
        self.tokens.append(token)
        self.network.tokens_changed()
        await asyncio.sleep(2 * HOP_S)
        try:
            yield
        finally:
            if token in self.tokens:
                self.tokens.remove(token)
                self.network.tokens_changed()

    async def who_is_alive(self, channel: Channel[Any], **ids: str) -> list[dict[str, str]]:
        """Return the ids of the tokens that are there."""
        await asyncio.sleep(2 * HOP_S)
        if not self.connected:
            return []
        return [
            found
            for bus in self.network.buses
            for kind, found in bus.tokens
            if kind is channel and all(found.get(k) == v for k, v in ids.items()) and not bus.link.lost
        ]

    @contextlib.asynccontextmanager
    async def serve(self, channel: Channel[Any], handler: Handler) -> AsyncGenerator[None]:
        """Answer requests while entered, each in its own task."""
        stream: Stream[Asked] = Stream()
        self.servers[channel.name] = stream
        running: set[asyncio.Task[None]] = set()

        async def accept() -> None:
            async for asked in stream:
                task = asyncio.create_task(self._handle(handler, asked))
                running.add(task)
                task.add_done_callback(running.discard)

        accepting = asyncio.create_task(accept())
        try:
            yield
        finally:
            self.servers.pop(channel.name, None)
            for task in (accepting, *running):
                task.cancel()
            await asyncio.gather(accepting, *running, return_exceptions=True)

    async def _handle(self, handler: Handler, asked: Asked) -> None:
        try:
            reply = await handler(asked.request)
        except Refusal as refusal:
            asked.answer(refusal)
        except Killed:
            return
        except Exception:  # noqa: BLE001  (as the real one: logged, and the asker is told nothing that is true)
            _log.exception("request_failed")
        else:
            asked.answer(reply)

    async def ask(self, channel: Channel[Any], request: BaseModel, timeout_s: float = 2.0) -> Any:
        """Send a request and return its reply; raises as the real one does."""
        done: asyncio.Future[BaseModel | Refusal] = self.network.loop.create_future()
        found = self.network.server(channel)
        if found is None:
            raise NoReplyError(f"nobody answers {channel.name}")
        server, stream = found

        def finish(reply: "BaseModel | Refusal") -> None:
            if not done.done():
                done.set_result(reply)

        def answer(reply: "BaseModel | Refusal") -> None:
            if not server.dead:
                self.network.carry(server, self, lambda: finish(reply))

        self.network.carry(self, server, lambda: stream.put(Asked(request, answer)))
        try:
            reply = await asyncio.wait_for(done, timeout_s)
        except TimeoutError as error:
            raise NoReplyError(f"{channel.name} was not answered") from error
        if isinstance(reply, Refusal):
            raise RefusedError(reply.error)
        return reply
