"""Starts the supervisor of a site, detached from the terminal, and stops it."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time

import psutil

from .errors import CliError
from .processes import Options, Plan
from .record import DataDirectory, SiteRecord
from .supervisor import ALREADY_UP

_STARTS_WITHIN_S = 60.0
_STOPS_WITHIN_S = 45.0


def start(plan: Plan, options: Options, directory: DataDirectory) -> SiteRecord:
    """Start the supervisor for `plan` and return its record; it goes on when this process ends.

    Raises:
        CliError: the site is up already, a port is taken, or the supervisor ended at once.

    """
    if holder := directory.holder():
        raise CliError(_already_up(holder))
    for port, option in ((options.bus_port, "--bus-port"), (options.port, "--port")):
        _check_free(port, option)
    log = directory.log_of("supervisor")
    log.parent.mkdir(parents=True, exist_ok=True)
    for process in (plan.first, *plan.rest):
        _keep_one_old(directory, process.name)
    directory.want(plan)
    with log.open("wb") as out:
        done = subprocess.run(  # noqa: S603  (our own interpreter and module)
            [sys.executable, "-m", "muster_cli.supervisor", str(directory.root)],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=out,
            start_new_session=True,
            check=False,
        )
    if done.returncode == ALREADY_UP:
        raise CliError(_already_up(directory.holder()))
    until = time.monotonic() + _STARTS_WITHIN_S
    while directory.held() and time.monotonic() < until:
        record = directory.read()
        if record is not None and record.supervisor_pid == directory.holder():
            return record
        time.sleep(0.05)
    stop(directory)
    raise CliError(f"The site's supervisor did not start; see {log}.")


def stop(directory: DataDirectory) -> bool:
    """Stop the site and wait until nothing of it runs; returns False if none was up.

    Raises:
        CliError: something could not be stopped.

    """
    pid = directory.holder()
    if pid is None:
        return False
    record = directory.read()
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGTERM)
    if not _released(directory, _STOPS_WITHIN_S):
        # It hangs; its children get their signal from the kernel when it goes.
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
        _released(directory, 5.0)
    left = _still_running(record)
    for process in left:
        with contextlib.suppress(psutil.NoSuchProcess):
            process.kill()
    _, alive = psutil.wait_procs(left, timeout=5.0)
    if alive or directory.held():
        names = ", ".join(str(p.pid) for p in alive) or str(pid)
        raise CliError(f"These processes of the site did not stop: {names}. Look at them with `ps`, end them by hand.")
    return True


def _already_up(pid: int | None) -> str:
    who = f" (supervisor {pid})" if pid else ""
    return f"The site is up already{who}. `muster status` shows it, `muster down` stops it."


def _check_free(port: int, option: str) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise CliError(
                f"Port {port} is taken by another program ({error.strerror}). Stop that one, or say {option} N."
            ) from error


def _keep_one_old(directory: DataDirectory, name: str) -> None:
    log = directory.log_of(name)
    if log.exists():
        log.replace(log.with_suffix(".log.old"))


def _released(directory: DataDirectory, within_s: float) -> bool:
    until = time.monotonic() + within_s
    while directory.held():
        if time.monotonic() > until:
            return False
        time.sleep(0.05)
    return True


def _still_running(record: SiteRecord | None) -> list[psutil.Process]:
    """Return what is left of the site's processes; a process id that someone else has by now does not count."""
    left: list[psutil.Process] = []
    for one in record.processes if record else ():
        if one.pid is None:
            continue
        with contextlib.suppress(psutil.NoSuchProcess, psutil.AccessDenied):
            process = psutil.Process(one.pid)
            argv = (
                next((p.argv for p in (record.plan.first, *record.plan.rest) if p.name == one.name), ())
                if record
                else ()
            )
            if tuple(process.cmdline()) == argv:
                left.append(process)
    return left
