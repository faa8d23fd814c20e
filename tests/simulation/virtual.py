"""Virtual time: an event loop that never waits, and clocks of which each simulated process has its own."""

import asyncio
import contextlib
import contextvars
import random
import secrets
import selectors
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any, Final

import pytest
import structlog

BEGIN: Final = 1_700_000_000.0
"""The wall clock when a run begins."""


@dataclass
class Clock:
    """One process's clocks, in seconds ahead of the run's own."""

    wall_ahead_s: float = 0.0
    monotonic_ahead_s: float = 0.0


OUTSIDE: Final = Clock()
CLOCK: Final = contextvars.ContextVar("clock", default=OUTSIDE)
"""Of the process whose code runs; tasks inherit it from whoever started them."""


class Killed(BaseException):
    """The process is gone at this very place; nothing of its code may run on."""


class DeadlockError(RuntimeError):
    """Nobody waits for time to pass, so nothing can ever happen again."""


class _NoWaiting(selectors.SelectSelector):
    """Lets time pass in place of waiting for it."""

    now = 0.0

    def select(self, timeout: float | None = None) -> list[Any]:
        if timeout is None:
            raise DeadlockError
        self.now += max(timeout, 0.0)
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """Runs everything in one thread, in an order that depends on nothing outside."""

    def __init__(self) -> None:
        self._waiting = _NoWaiting()
        super().__init__(self._waiting)

    def time(self) -> float:
        """Return the virtual seconds since the beginning."""
        return self._waiting.now

    def _write_to_self(self) -> None:
        """Wake nobody: there is only this thread, and it is awake."""


@dataclass
class Troubles:
    """What the services logged as an error: most errors are caught by them, and none may be overlooked."""

    entries: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])

    def __call__(self, _logger: object, _method: str, entry: Any) -> Any:
        """Take a log entry in, and nothing is printed."""
        self.entries.append(dict(entry))
        raise structlog.DropEvent


@contextlib.contextmanager
def virtual_time(seed: int) -> Generator[tuple[VirtualLoop, Troubles]]:
    """Make the clocks, fresh ids and logs of this process those of a run while entered."""
    loop = VirtualLoop()
    ids = random.Random(f"ids of {seed}")
    troubles = Troubles()

    def wall() -> float:
        return BEGIN + loop.time() + CLOCK.get().wall_ahead_s

    def token(size: int | None = None) -> str:
        return ids.randbytes(size or 16).hex()

    def uncaught(_loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        if not isinstance(context.get("exception"), Killed):
            troubles.entries.append({"event": "uncaught", **{k: repr(v) for k, v in context.items()}})

    loop.set_exception_handler(uncaught)
    before = structlog.get_config()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "time", wall)
        patch.setattr(time, "time_ns", lambda: int(wall() * 1e9))
        patch.setattr(time, "monotonic", lambda: loop.time() + CLOCK.get().monotonic_ahead_s)
        patch.setattr(secrets, "token_hex", token)
        wrapper = structlog.make_filtering_bound_logger("error")
        structlog.configure(
            processors=[structlog.processors.format_exc_info, troubles],
            wrapper_class=wrapper,
            cache_logger_on_first_use=False,
        )
        try:
            yield loop, troubles
        finally:
            structlog.configure(**before)
            loop.close()
