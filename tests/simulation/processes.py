"""The lives of scheduler and agents: started, killed at a place or a moment, started again by a supervisor."""

import asyncio
import contextlib
import contextvars
import shutil
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

from muster_bus import crash
from muster_bus.identity import Identity, sole
from muster_robot_agent import journal as agent_journal
from muster_robot_agent.agent import RobotAgent
from muster_robot_agent.core import Attempt
from muster_robot_agent.following import follow_site
from muster_robot_agent.history import History as NoHistory
from muster_robot_agent.surroundings import SiteView
from muster_scheduler.compaction import snapshot
from muster_scheduler.core.events import Policy
from muster_scheduler.core.invariants import validate
from muster_scheduler.engine import Engine
from muster_scheduler.journal import Journal
from muster_scheduler.recovery import replay
from muster_scheduler.shell import Shell
from muster_scheduler.storage.port import EventRow, JournalUnavailableError, SnapshotRow
from muster_scheduler.storage.sqlite import SqliteStore
from muster_schemas.ids import new_boot_id
from muster_schemas.site import Site

from .machines import Body, BodyDriver
from .network import Network, SimulatedBus
from .virtual import CLOCK, Clock, Killed

POLICY: Final = Policy(
    retry_after_s=0.5, object_wait_s=6.0, room_wait_s=6.0, cancel_wait_s=4.0, rules_wait_s=15.0, refusals=20
)


class Process(ABC):
    """One place for a process, with one life after the other."""

    def __init__(self, network: Network, name: str, folder: Path) -> None:
        self.network = network
        self.name = name
        self.folder = folder
        self.clock = Clock()
        self.disk_full = False
        self.forgets = False
        """Its next life finds an empty disk."""
        self.loses_words = False
        """What it has just sent is lost when it is killed: it had not left its buffers."""
        self.restart_after_s = 1.0
        self.places_left: int | None = None
        """So many places until it is killed."""
        self.place: str | None = None
        """Count only places of this name."""
        self.places_passed = 0
        self.lives = 0
        self.memory = 0
        self.problems: list[str] = []
        self._dead = True
        self._bus: SimulatedBus | None = None
        self._life: asyncio.Task[None] | None = None

    @property
    def bus(self) -> SimulatedBus | None:
        """What it speaks on, while it lives."""
        return None if self._dead else self._bus

    async def supervise(self) -> None:
        """Keep it running."""
        while True:
            if self.forgets:
                shutil.rmtree(self.folder, ignore_errors=True)
                self.forgets = False
                self.memory += 1
            self.folder.mkdir(parents=True, exist_ok=True)
            self.lives += 1
            self._dead = False
            self._life = asyncio.create_task(self._live(), name=f"{self.name} {self.lives}")
            await asyncio.wait((self._life,))
            error = None if self._life.cancelled() else self._life.exception()
            if not self._dead:
                self.kill()
                if error is not None and not self._excused(error):
                    self.problems.append(f"{self.name} ended with {_inner(error)!r}")
            await asyncio.sleep(self.restart_after_s)

    def kill(self) -> None:
        """End it as `kill -9` does."""
        if self._dead:
            return
        self._dead = True
        self.places_left = None
        if self._bus is not None and not self._bus.dead:
            self._bus.die(mute=self.loses_words)
        self.release()
        if self._life is not None:
            self._life.cancel()

    def passing(self, place: str) -> None:
        """Count a place that it passes, and kill it there if that was asked for."""
        if self._dead:
            raise Killed
        self.places_passed += 1
        if self.places_left is not None and self.place in (None, place):
            self.places_left -= 1
            if self.places_left <= 0:
                self.kill()
                raise Killed

    async def _live(self) -> None:
        CLOCK.set(self.clock)
        PROCESS.set(self)
        self._bus = SimulatedBus(self.network, self.name, new_boot_id())
        await self.main(self._bus)

    def _excused(self, error: BaseException) -> bool:
        return self.disk_full and isinstance(_inner(error), agent_journal.JournalError | JournalUnavailableError)

    @abstractmethod
    async def main(self, bus: SimulatedBus) -> None:
        """Do what the program's own `main` does."""

    @abstractmethod
    def release(self) -> None:
        """Give back what the system takes from a process that has gone."""


PROCESS: Final = contextvars.ContextVar[Process | None]("process", default=None)


def passing(place: str) -> None:
    """Tell the process whose code runs that it is at a place."""
    process = PROCESS.get()
    if process is not None:
        process.passing(place)


class _Store(SqliteStore):
    """On a disk that may be full."""

    process: Process

    def append(self, rows: Sequence[EventRow]) -> None:
        if self.process.disk_full:
            raise JournalUnavailableError("the disk is full")
        super().append(rows)

    def probe(self) -> None:
        if self.process.disk_full:
            raise JournalUnavailableError("the disk is full")
        super().probe()


class SchedulerProcess(Process):
    """`python -m muster_scheduler`."""

    def __init__(self, network: Network, site: Site, folder: Path) -> None:
        super().__init__(network, "scheduler", folder)
        self.site = site
        self._journal: Journal | None = None
        self._shell: Shell | None = None

    async def main(self, bus: SimulatedBus) -> None:
        """As `muster_scheduler.__main__`."""
        real: Any = bus
        store = _Store.open(self.folder, self.site.name)
        store.process = self
        self._journal = Journal(store)
        core = replay(self._journal)
        validate(core.state)
        async with sole(real, Identity("service", "scheduler")):
            self._shell = Shell(real, self.site, core, self._journal, self._make_snapshot)
            await self._shell.run(asyncio.Event(), POLICY)

    async def _make_snapshot(self) -> SnapshotRow:
        """As `muster_scheduler.compaction`, which is a process of its own and only reads."""
        journal = Journal(SqliteStore.read(self.folder, self.site.name))
        try:
            return snapshot(journal)
        finally:
            journal.close()

    def release(self) -> None:
        """Close the files."""
        if self._journal is not None:
            self._journal.close()
            self._journal = self._shell = None

    @property
    def engine(self) -> Engine | None:
        """The running one."""
        return vars(self._shell)["_engine"] if self._shell is not None and self.bus is not None else None

    def check(self) -> None:
        """Look at the state, and at what its journal tells, from outside.

        Raises:
            AssertionError: the state contradicts itself or its journal (invariant I5).

        """
        engine = self.engine
        if engine is None or engine.core.state.epoch == 0:
            return
        validate(engine.core.state)

    def check_replay(self) -> None:
        """Compare the state with the replay of the journal; raises as `check`."""
        engine = self.engine
        if engine is not None and self._journal is not None:
            again = replay(self._journal).state
            state = engine.core.state
            other = [f.name for f in fields(state) if f.compare and getattr(state, f.name) != getattr(again, f.name)]
            if other:
                raise AssertionError(f"I5: the replay of the journal has other {', '.join(other)}")


class _AgentJournal(agent_journal.Journal):
    """On a disk that may be full."""

    process: Process

    def save(self, attempt: Attempt, epoch: int) -> None:
        if self.process.disk_full:
            raise agent_journal.JournalError("the disk is full")
        super().save(attempt, epoch)


class AgentProcess(Process):
    """`python -m muster_robot_agent` of one robot."""

    def __init__(self, network: Network, site: Site, folder: Path, body: Body) -> None:
        super().__init__(network, body.robot_id, folder)
        self.site = site
        self.body = body
        self._journal: _AgentJournal | None = None

    async def main(self, bus: SimulatedBus) -> None:
        """As `muster_robot_agent.__main__`."""
        real: Any = bus
        async with sole(real, Identity("robot", self.name)) as must_yield, contextlib.AsyncExitStack() as stack:
            view = SiteView(self.site)
            journal = self._journal = _AgentJournal(self.folder, self.name)
            journal.process = self
            stack.enter_context(journal)
            journal.prune(time.time())
            agent = RobotAgent(real, view, self.name, BodyDriver(self.body), journal, NoHistory(None))
            works = [agent.run(), follow_site(real, view), must_yield.wait()]
            tasks: list[asyncio.Task[Any]] = [asyncio.ensure_future(w) for w in works]
            try:
                await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in tasks:
                    task.cancel()
                results = await asyncio.gather(*tasks, return_exceptions=True)
            for result in results:
                if isinstance(result, BaseException) and not isinstance(result, asyncio.CancelledError):
                    raise result

    def release(self) -> None:
        """Let the machine stand still, and close the files."""
        self.body.halt()
        if self._journal is not None:
            self._journal.__exit__(None, None, None)
            self._journal = None


def _inner(error: BaseException) -> BaseException:
    """Return the first error within groups of errors."""
    exceptions: tuple[BaseException, ...] = getattr(error, "exceptions", ())
    return _inner(exceptions[0]) if exceptions else error


def listen_for_places() -> None:
    """Let every place that a process passes be counted."""
    crash.on_passing(passing)
