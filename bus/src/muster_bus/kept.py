"""The owner's side of state channels: keeps last values, answers queries for them, sends them again after an outage.

A put during an outage of the router is lost without an error, and a late subscriber never saw the earlier ones. So
the owner is the memory: it answers for its own keys (several owners share a channel, such as all robots' cards), and
repeats what it keeps when its link comes back. A value or delete carries one Zenoh timestamp for life, so repeats are
recognised.
"""

# pyright: reportUnknownMemberType=false
# (Zenoh's stubs leave return types out.)

import asyncio
import threading
from collections import OrderedDict
from typing import Any

import structlog
import zenoh
from muster_schemas.channels import Channel

from .inbox import Inbox, InboxClosedError
from .wire import JSON

_log = structlog.stdlib.get_logger(__name__)

_DELETES = 10_000
"""Deletes that are remembered, for subscribers that were cut off when they happened."""
_CHUNK = 50
"""Values sent before other tasks get their turn."""

_Value = tuple[bytes | None, zenoh.Timestamp]


class KeptValues:
    """All state channels of one process. `put` and `delete` may be called from any thread."""

    def __init__(self, session: zenoh.Session, site: str) -> None:
        self._session = session
        self._site = site
        self._lock = threading.Lock()
        self._values: dict[str, dict[str, _Value]] = {}
        self._deleted: OrderedDict[tuple[str, str], None] = OrderedDict()
        self._queryables: list[zenoh.Queryable[None]] = []
        self._queries: Inbox[tuple[str, zenoh.Query]] = Inbox()

    def put(self, channel: Channel[Any], key: str, payload: bytes) -> None:
        """Keep and send a value."""
        with self._lock:  # so that stamps grow in the order in which values go out
            self._own(channel)
            stamp = self._session.new_timestamp()
            self._deleted.pop((channel.name, key), None)
            self._values[channel.name][key] = (payload, stamp)
            self._send(key, (payload, stamp))

    def delete(self, channel: Channel[Any], key: str) -> None:
        """Forget and delete a value."""
        with self._lock:
            self._own(channel)
            stamp = self._session.new_timestamp()
            self._values[channel.name][key] = (None, stamp)
            self._deleted[channel.name, key] = None
            if len(self._deleted) > _DELETES:
                (name, oldest), _ = self._deleted.popitem(last=False)
                del self._values[name][oldest]
            self._send(key, (None, stamp))

    async def answer(self) -> None:
        """Answer queries until cancelled."""
        while True:
            try:
                name, query = await self._queries.get()
            except InboxClosedError:
                return
            try:
                await self._answer(name, query)
            except zenoh.ZError as error:  # the asker has gone
                _log.debug("answer_failed", channel=name, error=str(error))
            finally:
                query.drop()

    async def send_again(self) -> None:
        """Send every kept value and delete again."""
        with self._lock:
            keys = [(name, key) for name, values in self._values.items() for key in values]
        for i, (name, key) in enumerate(keys):
            with self._lock:
                value = self._values[name].get(key)
                if value is not None:
                    self._send(key, value)
            if i % _CHUNK == _CHUNK - 1:
                await asyncio.sleep(0)

    def close(self) -> None:
        """Answer no more."""
        self._queries.close()
        for queryable in self._queryables:
            queryable.undeclare()

    def _own(self, channel: Channel[Any]) -> None:
        if channel.name in self._values:
            return
        self._values[channel.name] = {}

        def enqueue(query: zenoh.Query) -> None:
            self._queries.put("", (channel.name, query))

        callback = zenoh.handlers.Callback(enqueue, indirect=False)
        # Not "complete": each owner has only its own keys, so a query must go to all of them.
        self._queryables.append(self._session.declare_queryable(channel.key(site=self._site), callback, complete=False))

    def _send(self, key: str, value: _Value) -> None:
        payload, stamp = value
        block, priority = zenoh.CongestionControl.BLOCK, zenoh.Priority.DATA_HIGH
        if payload is None:
            self._session.delete(key, congestion_control=block, priority=priority, timestamp=stamp)
        else:
            self._session.put(key, payload, encoding=JSON, congestion_control=block, priority=priority, timestamp=stamp)

    async def _answer(self, name: str, query: zenoh.Query) -> None:
        wanted = query.key_expr
        exact = str(wanted)
        with self._lock:
            values = self._values[name]
            found = [(exact, values[exact])] if exact in values else list(values.items()) if "*" in exact else []
        for i, (key, (payload, stamp)) in enumerate(found):
            if key != exact and not wanted.intersects(zenoh.KeyExpr(key)):
                continue
            if payload is None:
                query.reply_del(key, timestamp=stamp)
            else:
                query.reply(key, payload, encoding=JSON, timestamp=stamp)
            if i % _CHUNK == _CHUNK - 1:
                await asyncio.sleep(0)
