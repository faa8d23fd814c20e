"""What the readers of the faulty bus hold: subscriptions, and followers of liveliness."""

import asyncio
from collections import deque
from collections.abc import Mapping
from typing import Any, Generic, Self, TypeVar

from muster_bus import Presence, Received
from muster_schemas.channels import Channel, Kind
from pydantic import BaseModel

T = TypeVar("T")

Value = tuple[int, BaseModel | None]
"""(stamp, message or None if it was retracted)"""


class Stream(Generic[T]):
    """What a reader iterates over; ends when it is closed and empty."""

    def __init__(self) -> None:
        self._items: deque[T] = deque()
        self._ready = asyncio.Event()
        self._closed = False

    def put(self, item: T) -> None:
        """Hand an item to the reader."""
        if not self._closed:
            self._items.append(item)
            self._ready.set()

    def close(self) -> None:
        """Give nothing more."""
        self._closed = True
        self._ready.set()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> T:
        while not self._items:
            if self._closed:
                raise StopAsyncIteration
            self._ready.clear()
            await self._ready.wait()
        return self._items.popleft()


class Reader(Stream[Received[Any]]):
    """One subscription. Of a state channel it takes a value only if it is newer than the one it has."""

    def __init__(self, channel: Channel[Any], ids: Mapping[str, str]) -> None:
        super().__init__()
        self.channel = channel
        self.wanted = dict(ids)
        self._stamps: dict[str, int] = {}

    def matches(self, channel: Channel[Any], ids: Mapping[str, str]) -> bool:
        """Return whether a message on a key is for this reader."""
        return channel is self.channel and all(ids.get(k) == v for k, v in self.wanted.items())

    def take(self, ids: dict[str, str], value: Value) -> None:
        """Take in a message."""
        stamp, message = value
        if self.channel.kind is Kind.STATE:
            key = self.channel.key(**ids)
            if self._stamps.get(key, -1) >= stamp:
                return
            self._stamps[key] = stamp
        self.put(Received(message, ids))


class Watcher(Stream[Presence]):
    """One follower of liveliness tokens."""

    def __init__(self, channel: Channel[Any], ids: Mapping[str, str]) -> None:
        super().__init__()
        self.channel = channel
        self.wanted = dict(ids)
        self.seen: dict[tuple[str, ...], dict[str, str]] = {}
