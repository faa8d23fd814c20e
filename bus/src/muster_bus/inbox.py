"""The way from Zenoh's threads into the event loop.

A callback on Zenoh's receiving thread may do nothing but `put`: a slow one would starve every other subscription of the
session, and heartbeats with them. Wake-ups are batched, so a flood costs the loop one callback, not one a message.
"""

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

_BREATHER = 64
"""Items that a reader may take in a row before other tasks get their turn."""


class InboxClosedError(Exception):
    """Nothing will come any more."""


class Inbox(Generic[T]):
    """Items for one reader. `newest_only` keeps the newest of each key, else all in order up to `limit`.

    A full one forgets the oldest of those whose key has a newer one if `by_key` (nothing that still counts is lost),
    else it turns new ones away and counts them in `overflowed`.
    """

    def __init__(self, *, newest_only: bool = False, by_key: bool = False, limit: int = 20_000) -> None:
        self._loop = asyncio.get_running_loop()
        self._newest: dict[str, T] | None = {} if newest_only else None
        self._queue: deque[tuple[str, T]] = deque()
        self._by_key = by_key
        self._limit = limit
        self._lock = threading.Lock()
        self._ready = asyncio.Event()
        self._wake_due = False
        self._closed = False
        self._in_a_row = 0
        self.overflowed = 0

    def put(self, key: str, item: T) -> None:
        """Add an item; from any thread."""
        with self._lock:
            if self._closed:
                return
            if self._newest is not None:
                self._newest[key] = item
            elif len(self._queue) < self._limit or self._made_room():
                self._queue.append((key, item))
            else:
                self.overflowed += 1
                return
            if self._wake_due:
                return
            self._wake_due = True
        self._wake()

    def close(self) -> None:
        """Let the reader take what is there and then end; from any thread."""
        with self._lock:
            self._closed = True
        self._wake()

    async def get(self) -> T:
        """Return the next item.

        Raises:
            InboxClosedError: it is closed and empty.

        """
        self._in_a_row += 1
        if self._in_a_row > _BREATHER:
            self._in_a_row = 0
            await asyncio.sleep(0)
        while True:
            with self._lock:
                if self._newest:
                    return self._newest.pop(next(iter(self._newest)))
                if self._queue:
                    return self._queue.popleft()[1]
                if self._closed:
                    raise InboxClosedError
                self._wake_due = False
                self._ready.clear()
            self._in_a_row = 0
            await self._ready.wait()

    def _wake(self) -> None:
        call_in(self._loop, self._ready.set)

    def _made_room(self) -> bool:
        """Drop what a newer item of the same key has replaced."""
        if not self._by_key:
            return False
        newest = dict(self._queue)  # the last one of each key wins, in the order in which the keys came
        self._queue = deque(newest.items())
        # Many keys are no flood: rather grow than lose one, and do not sort again for every item.
        self._limit = max(self._limit, 2 * len(self._queue))
        return True


def call_in(loop: asyncio.AbstractEventLoop, callback: Callable[[], object]) -> None:
    """Call it in the loop soon, from any thread; not at all if the loop is closed, for nobody waits there any more."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(callback)
