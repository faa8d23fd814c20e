"""Testing support for everything that runs on the bus: a real router, real buses, real service processes.

A pytest plugin (entry point `muster_bus`), so its fixtures are there in every package's tests:

    async def test_it_answers(router: RouterProcess) -> None:
        async with service_process("muster_scheduler", router) as scheduler, running_bus(router) as bus:
            await eventually(lambda: ..., within_s=10)
"""

import asyncio
import contextlib
import json
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import AsyncGenerator, Awaitable, Callable, Generator, Mapping
from inspect import isawaitable
from pathlib import Path
from typing import Any, TypeVar, cast

import pytest

from .bus import Bus, open_bus
from .settings import child_environment

T = TypeVar("T")

SITE_FILE = Path(__file__).parents[3] / "sites" / "yard.yaml"
START_WITHIN_S = 240.0
"""Generous, like all limits here: tests run beside other work on few cores, and no test may fail for that."""
STOP_WITHIN_S = 120.0


def free_port() -> int:
    """Return a TCP port that nobody listens on now.

    It is below those that systems give to outgoing connections (Linux: from 32768 on), so none of them takes it before
    its process binds it, nor while that process is being started again.
    """
    while True:
        port = 10_000 + secrets.randbelow(22_000)
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


async def eventually(condition: Callable[[], T | Awaitable[T]], within_s: float = 120.0) -> T:
    """Return the condition's first true value; fail the test if there is none within the time."""
    give_up = time.monotonic() + within_s
    while True:
        result = condition()
        value = cast("T", await result) if isawaitable(result) else result
        if value:
            return value
        if time.monotonic() >= give_up:
            pytest.fail(f"still not so after {within_s:g} s; last value: {value!r}")
        await asyncio.sleep(0.02)


class Process:
    """A `python -m module` whose log lines are collected while it runs."""

    def __init__(self, module: str, environment: Mapping[str, str], *arguments: str) -> None:
        self.module = module
        self.lines: list[str] = []
        """Its stderr (and stdout), line by line."""
        self._popen = subprocess.Popen(  # noqa: S603  (our own modules)
            [sys.executable, "-m", module, *arguments],
            env=child_environment(environment),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            encoding="utf-8",
            errors="replace",
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def logs(self) -> list[dict[str, Any]]:
        """Its log lines so far, parsed; lines that are no JSON objects are left out."""
        found: list[dict[str, Any]] = []
        for line in tuple(self.lines):
            with contextlib.suppress(json.JSONDecodeError):
                parsed: object = json.loads(line)
                if isinstance(parsed, dict):
                    found.append(cast("dict[str, Any]", parsed))
        return found

    @property
    def output(self) -> str:
        """All it has written so far."""
        return "\n".join(self.lines)

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._popen.pid

    @property
    def exit_code(self) -> int | None:
        """None while it runs."""
        return self._popen.poll()

    def logged(self, event: str) -> list[dict[str, Any]]:
        """Return its log lines with this event."""
        return [line for line in self.logs if line.get("event") == event]

    async def until_logged(self, event: str, within_s: float = START_WITHIN_S) -> dict[str, Any]:
        """Return the first log line with this event; fail the test if it ends or the time passes before."""

        def found() -> list[dict[str, Any]]:
            lines = self.logged(event)
            if not lines and self.exit_code is not None:
                pytest.fail(f"{self.module} ended with {self.exit_code} before {event!r}:\n{self.output}")
            return lines

        return (await eventually(found, within_s))[0]

    async def ended(self, within_s: float = STOP_WITHIN_S) -> int:
        """Wait for its end and return the exit code; its output is then complete."""
        await eventually(lambda: self.exit_code is not None, within_s)
        await asyncio.to_thread(self._reader.join)
        code = self.exit_code
        assert code is not None  # noqa: S101  (just waited for)
        return code

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self._popen.send_signal(number)

    async def terminate(self) -> int:
        """Ask it to end (SIGTERM) and return its exit code."""
        self.signal(signal.SIGTERM)
        return await self.ended()

    async def kill(self) -> None:
        """End it as a power cut would (SIGKILL)."""
        self.signal(signal.SIGKILL)
        await self.ended()

    def dispose(self) -> None:
        """Make sure that nothing is left of it."""
        if self._popen.poll() is None:
            self._popen.kill()
        self._popen.wait()
        self._reader.join()
        if self._popen.stdout is not None:
            self._popen.stdout.close()

    def _read(self) -> None:
        assert self._popen.stdout is not None  # noqa: S101  (a pipe was asked for)
        for line in self._popen.stdout:
            self.lines.append(line.rstrip("\n"))


class RouterProcess:
    """A router on a port of its own, which can be killed and come back on the same port."""

    def __init__(self) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._process: Process | None = None

    @property
    def environment(self) -> dict[str, str]:
        """What a service needs to find this router and the default site."""
        return {"MUSTER_CONNECT": self.endpoint, "MUSTER_SITE_FILE": str(SITE_FILE)}

    @property
    def process(self) -> Process:
        """The process that runs now."""
        assert self._process is not None, "the router was not started"  # noqa: S101  (a mistake in the test)
        return self._process

    def start(self) -> None:
        """Start it and wait until it listens."""
        self._process = Process("muster_bus.router", {"MUSTER_LISTEN": self.endpoint})
        give_up = time.monotonic() + START_WITHIN_S
        while not self._process.logged("alive"):
            if self._process.exit_code is not None or time.monotonic() >= give_up:
                pytest.fail(f"the router did not start:\n{self._process.output}")
            time.sleep(0.02)

    def kill(self) -> None:
        """End it as a power cut would (SIGKILL)."""
        self.process.signal(signal.SIGKILL)
        self.process.dispose()

    def dispose(self) -> None:
        """Make sure that nothing is left of it."""
        if self._process is not None:
            self._process.dispose()


@contextlib.contextmanager
def running_router() -> Generator[RouterProcess]:
    """Run a router of one's own; for fixtures of another scope than `router`'s."""
    process = RouterProcess()
    try:
        process.start()
        yield process
    finally:
        process.dispose()


@pytest.fixture
def router() -> Generator[RouterProcess]:
    """Provide a real router, new for each test."""
    with running_router() as process:
        yield process


def running_bus(router: RouterProcess, site: str = "yard") -> contextlib.AbstractAsyncContextManager[Bus]:
    """Return a context that is a bus of the test's own on this router."""
    return open_bus(site, (router.endpoint,))


@contextlib.asynccontextmanager
async def service_process(
    module: str, router: RouterProcess, env: Mapping[str, str] | None = None, *, wait: bool = True
) -> AsyncGenerator[Process]:
    """Run `python -m module` on this router; with `wait` it is alive on the bus when the context begins.

    On leaving it is asked to end, and killed if it does not in time. The test looks at its exit code itself.
    """
    process = Process(module, {**router.environment, **(env or {})})
    try:
        if wait:
            await process.until_logged("alive")
        yield process
        if process.exit_code is None:
            await process.terminate()
    finally:
        await asyncio.to_thread(process.dispose)
