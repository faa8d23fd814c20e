"""What has changed on the site, handed to everyone who listens over HTTP; a slow listener delays no other."""

import asyncio
from collections.abc import AsyncGenerator, Generator
from contextlib import contextmanager
from dataclasses import dataclass

MAX_LISTENERS = 100
_MAX_WAITING = 2_000
"""Events that wait for one listener; at 30 a second more than a minute."""


@dataclass(frozen=True)
class Event:
    """One change: `kind` is mission, task, robot, object or areas; `data` is its JSON."""

    kind: str
    data: str


class TooManyListenersError(Exception):
    """There are `MAX_LISTENERS` already."""


class Listener:
    """One reader; iterate over it."""

    def __init__(self) -> None:
        self._queue: asyncio.Queue[Event | None] = asyncio.Queue(_MAX_WAITING + 1)
        self._ended = False

    def put(self, event: Event) -> None:
        """Hand over an event; a listener that is too far behind is ended, so that it comes again and reads anew."""
        if self._ended:
            return
        if self._queue.qsize() >= _MAX_WAITING:
            self.end()
            return
        self._queue.put_nowait(event)

    def end(self) -> None:
        """Let the reader finish after what waits for it."""
        if not self._ended:
            self._ended = True
            self._queue.put_nowait(None)

    async def read(self) -> AsyncGenerator[Event]:
        """Yield events until the end."""
        while (event := await self._queue.get()) is not None:
            yield event


class Hub:
    """Hands each event to every listener."""

    def __init__(self) -> None:
        self._listeners: set[Listener] = set()
        self._closed = False

    @property
    def listeners(self) -> int:
        """How many there are."""
        return len(self._listeners)

    def send(self, event: Event) -> None:
        """Hand over an event; cheap."""
        for listener in self._listeners:
            listener.put(event)

    @contextmanager
    def listen(self) -> Generator[Listener]:
        """Listen while entered.

        Raises:
            TooManyListenersError: come back later.

        """
        if len(self._listeners) >= MAX_LISTENERS:
            raise TooManyListenersError
        listener = Listener()
        self._listeners.add(listener)
        if self._closed:
            listener.end()
        try:
            yield listener
        finally:
            self._listeners.discard(listener)

    def close(self) -> None:
        """End every listener, now and later."""
        self._closed = True
        for listener in self._listeners:
            listener.end()
