"""What the supervisor of a site leaves in the data directory: who it is, and how each process stands.

The lock is what counts: whoever holds it is alive, so a file that a crash left behind misleads nobody.
"""

import contextlib
import fcntl
import os
from collections.abc import Generator
from enum import StrEnum
from pathlib import Path

from muster_schemas.base import Message
from pydantic import ValidationError

from .processes import Plan


class Standing(StrEnum):
    """How one process stands."""

    WAITING = "waiting"
    """For the router."""
    RUNNING = "running"
    RESTARTING = "restarting"
    """It ended, and is started again after a pause."""
    GIVEN_UP = "given up"
    """It said that starting it again is of no use."""
    STOPPED = "stopped"


class ProcessRecord(Message):
    """One process now."""

    name: str
    standing: Standing = Standing.WAITING
    pid: int | None = None
    restarts: int = 0
    exit_code: int | None = None
    since: float


class SiteRecord(Message):
    """The whole site now."""

    supervisor_pid: int
    started_at: float
    plan: Plan
    processes: tuple[ProcessRecord, ...]


class DataDirectory:
    """The files of one site below its data directory."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._record = root / "site.json"
        self._wanted = root / "wanted.json"
        self._lock = root / "site.lock"

    def log_of(self, name: str) -> Path:
        """Return where a process writes its log."""
        return self.root / "logs" / f"{name}.log"

    def want(self, plan: Plan) -> None:
        """Leave the plan for a supervisor that is about to start, and forget what an earlier one said."""
        self._record.unlink(missing_ok=True)
        _replace(self._wanted, plan.to_json())

    def wanted(self) -> Plan:
        """Return the plan that was left."""
        return Plan.model_validate_json(self._wanted.read_bytes())

    def write(self, record: SiteRecord) -> None:
        """Replace the record at once, so that no reader sees half of it."""
        _replace(self._record, record.to_json())

    def read(self) -> SiteRecord | None:
        """Return the record of the site that is up, or None if none is."""
        if not self.held():
            return None
        try:
            return SiteRecord.model_validate_json(self._record.read_bytes())
        except (OSError, ValidationError):
            return None

    def held(self) -> bool:
        """Whether a supervisor is alive."""
        try:
            descriptor = os.open(self._lock, os.O_RDWR)
        except OSError:
            return False
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        finally:
            os.close(descriptor)
        return False

    def holder(self) -> int | None:
        """Return the process id of the supervisor that is alive, or None."""
        if not self.held():
            return None
        text = self._lock.read_text()
        return int(text) if text.isdigit() else None

    @contextlib.contextmanager
    def lock(self) -> Generator[bool]:
        """Hold the lock of the site; yields whether it was free."""
        self.root.mkdir(parents=True, exist_ok=True)
        with self._lock.open("a") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                yield False
                return
            yield True

    def sign(self) -> None:
        """Write this process's id into the lock that it holds."""
        self._lock.write_text(str(os.getpid()))


def _replace(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_suffix(".new")
    new.write_bytes(content)
    new.replace(path)
