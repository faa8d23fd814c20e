"""Keeps the processes of a site running until it is told to stop: `python -m muster_cli.supervisor DATA_DIR`.

`muster up` starts it, and SIGTERM ends it. Its children die with it, however it ends.
"""

import asyncio
import contextlib
import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

from .processes import Process
from .record import DataDirectory, ProcessRecord, SiteRecord, Standing
from .settings import inherited_environment

ALREADY_UP = 75
FINAL_EXIT_CODES = frozenset({2, 69, 78})
"""Wrong settings, or the same service is alive elsewhere: starting again changes nothing."""
_PAUSES_S = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_STEADY_S = 30.0
_GRACE_S = 15.0
_ROUTER_S = 20.0
_PR_SET_PDEATHSIG = 1


class Supervisor:
    """Runs the plan that lies in the data directory."""

    def __init__(self, directory: DataDirectory) -> None:
        self._directory = directory
        self._plan = directory.wanted()
        now = time.time()
        self._started_at = now
        self._records = {p.name: ProcessRecord(name=p.name, since=now) for p in (self._plan.first, *self._plan.rest)}
        self._children: dict[str, asyncio.subprocess.Process] = {}
        self._stop = asyncio.Event()

    def stop(self) -> None:
        """End everything in an orderly way."""
        self._stop.set()

    async def run(self) -> None:
        """Run until `stop`; when this returns, no child is left."""
        self._publish()
        keepers = [asyncio.create_task(self._keep(self._plan.first))]
        try:
            await self._router_listens()
            keepers += [asyncio.create_task(self._keep(p)) for p in self._plan.rest]
            await self._stop.wait()
        finally:
            self._stop.set()
            # The router goes last: the others still say goodbye over it.
            await asyncio.gather(*(self._end(p.name) for p in self._plan.rest))
            await self._end(self._plan.first.name)
            await asyncio.gather(*keepers)

    async def _keep(self, process: Process) -> None:
        failures = 0
        while not self._stop.is_set():
            began = time.monotonic()
            code = await self._run_once(process)
            if self._stop.is_set():
                break
            if code in FINAL_EXIT_CODES:
                self._note(process.name, standing=Standing.GIVEN_UP, pid=None, exit_code=code)
                return
            failures = 0 if time.monotonic() - began > _STEADY_S else failures + 1
            restarts = self._records[process.name].restarts + 1
            self._note(process.name, standing=Standing.RESTARTING, pid=None, exit_code=code, restarts=restarts)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._stop.wait(), _PAUSES_S[min(failures, len(_PAUSES_S) - 1)])
        self._note(process.name, standing=Standing.STOPPED, pid=None)

    async def _run_once(self, process: Process) -> int:
        log = self._directory.log_of(process.name)
        with log.open("ab") as out:
            child = await asyncio.create_subprocess_exec(
                *process.argv,
                env=inherited_environment() | process.env,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=out,
                stderr=out,
                start_new_session=True,
                preexec_fn=_dies_with_parent(),
            )
        self._children[process.name] = child
        self._note(process.name, standing=Standing.RUNNING, pid=child.pid)
        if self._stop.is_set():  # told to stop while the child was being made
            child.terminate()
        return await child.wait()

    async def _end(self, name: str) -> None:
        child = self._children.get(name)
        if child is None or child.returncode is not None:
            return
        with contextlib.suppress(ProcessLookupError):
            child.terminate()
        try:
            await asyncio.wait_for(child.wait(), _GRACE_S)
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                child.kill()
            await child.wait()

    async def _router_listens(self) -> None:
        """Wait until the router takes connections; after a while the others start all the same, and say why."""
        host, port = self._plan.endpoint.removeprefix("tcp/").rsplit(":", 1)
        until = time.monotonic() + _ROUTER_S
        while time.monotonic() < until and not self._stop.is_set():
            with contextlib.suppress(OSError):
                _, writer = await asyncio.open_connection(host, int(port))
                writer.close()
                return
            await asyncio.sleep(0.05)

    def _note(self, name: str, **changes: object) -> None:
        self._records[name] = self._records[name].model_copy(update={"since": time.time(), **changes})
        self._publish()

    def _publish(self) -> None:
        self._directory.write(
            SiteRecord(
                supervisor_pid=os.getpid(),
                started_at=self._started_at,
                plan=self._plan,
                processes=tuple(self._records.values()),
            )
        )


def _dies_with_parent() -> Callable[[], None] | None:
    """Return what a child does before it runs: ask Linux to kill it when its parent ends, even by `kill -9`."""
    if sys.platform != "linux":
        return None
    libc = ctypes.CDLL(None, use_errno=True)
    parent = os.getpid()

    def ask() -> None:
        libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)

    return ask


async def _main(directory: DataDirectory) -> None:
    supervisor = Supervisor(directory)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, supervisor.stop)
    await supervisor.run()


def main(root: Path) -> int:
    """Supervise the site whose data directory is `root`.

    Returns as soon as a child of this process has taken over, whose parent nobody has to be: 0, or `ALREADY_UP`.
    """
    directory = DataDirectory(root)
    with directory.lock() as free:
        if not free:
            return ALREADY_UP
        if os.fork():
            return 0  # the lock goes on with the child
        directory.sign()
        asyncio.run(_main(directory))
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
