"""`muster monitor`: what goes over the bus, as a live table of keys or as lines of JSON."""

import asyncio
import json
import re
import time
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from muster_bus import Bus, Received
from muster_schemas.base import Message
from muster_schemas.channels import CHANNELS, Channel, Kind
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from .errors import CliError

_RATE_WINDOW_S = 5.0
_REFRESH_S = 0.3
_NO_TRAFFIC = (Kind.QUERY, Kind.LIVELINESS)

Queue = asyncio.Queue[tuple[str, str]]


@dataclass
class KeyTraffic:
    """What has come on one key."""

    count: int = 0
    last: str = ""
    times: list[float] = field(default_factory=list[float])

    def add(self, value: str, now: float) -> None:
        """Count one message."""
        self.count += 1
        self.last = value
        self.times = [t for t in self.times if now - t < _RATE_WINDOW_S] + [now]

    def rate_hz(self, now: float) -> float:
        """Return messages a second over the last seconds."""
        return len([t for t in self.times if now - t < _RATE_WINDOW_S]) / _RATE_WINDOW_S


def key_filter(expression: str | None) -> re.Pattern[str]:
    """Return what keys match: `*` is one part of a key, `**` any number, plain text any key that holds it.

    Raises:
        CliError: it has characters that no key has.

    """
    if expression is None:
        return re.compile(".*")
    if not re.fullmatch(r"[a-z0-9_*/-]+", expression):
        raise CliError(f"{expression!r} cannot match any key: a key has only a-z, 0-9, '_', '-', '/' and '*'.", 2)
    if "*" not in expression:
        return re.compile(f".*{re.escape(expression)}.*")
    body = re.escape(expression).replace(r"\*\*", ".*").replace(r"\*", "[^/]*")
    return re.compile(body if expression.startswith(("muster", "*")) else f".*{body}")


def text_of(received: Received[Any]) -> str:
    """Return a message as one line of JSON; a picture as its metadata; `null` for one that was deleted."""
    message: Message | None = received.message
    return "null" if message is None else message.to_json().decode()


@asynccontextmanager
async def traffic(bus: Bus, expression: str | None) -> AsyncGenerator[Queue]:
    """Give a queue into which (key, JSON) of every message goes whose key matches."""
    wanted = key_filter(expression)
    queue = Queue(10_000)

    async def pump(channel: Channel[Any]) -> None:
        async with bus.subscribe(channel) as messages:
            async for received in messages:
                key = channel.key(site=bus.site, **received.ids)
                if wanted.fullmatch(key):
                    await queue.put((key, text_of(received)))

    pumps = [asyncio.create_task(pump(c)) for c in CHANNELS if c.kind not in _NO_TRAFFIC]
    try:
        yield queue
    finally:
        for task in pumps:
            task.cancel()
        await asyncio.gather(*pumps, return_exceptions=True)


async def print_lines(bus: Bus, expression: str | None) -> None:
    """Print `{"key", "at", "message"}`, one line for each message."""
    async with traffic(bus, expression) as queue:
        while True:
            key, text = await queue.get()
            print(f'{{"key": {json.dumps(key)}, "at": {time.time():.3f}, "message": {text}}}', flush=True)  # noqa: T201


async def show_table(bus: Bus, expression: str | None, console: Console) -> None:
    """Keep a table of keys with their rate and last value on the screen."""
    seen: dict[str, KeyTraffic] = {}
    screen = Live(console=console, screen=console.is_terminal, auto_refresh=False)
    async with traffic(bus, expression) as queue:
        with screen:
            while True:
                await asyncio.sleep(_REFRESH_S)
                while not queue.empty():
                    key, text = queue.get_nowait()
                    seen.setdefault(key, KeyTraffic()).add(text, time.monotonic())
                screen.update(_table(seen, console.height), refresh=True)


def _table(seen: dict[str, KeyTraffic], height: int) -> Table:
    now = time.monotonic()
    table = Table(box=None, pad_edge=False, header_style="dim", caption=f"{len(seen)} keys; Ctrl-C ends")
    table.add_column("key", no_wrap=True)
    table.add_column("Hz", justify="right")
    table.add_column("count", justify="right")
    table.add_column("last value", no_wrap=True, overflow="ellipsis")
    shown = sorted(seen.items())[: max(height - 3, 1)]
    for key, one in shown:
        table.add_row(key, f"{one.rate_hz(now):.1f}", str(one.count), Text(one.last))
    return table
