"""The supervisor, as `muster up` starts it, over real processes."""

import os
import signal
import socket
import time
from collections.abc import Callable

import psutil
import pytest
from muster_cli.errors import CliError
from muster_cli.launch import start, stop
from muster_cli.processes import Options, Plan
from muster_cli.record import DataDirectory, ProcessRecord, Standing

FOREVER = "import time; time.sleep(3600)"
STUBBORN = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(3600)"
PlanMaker = Callable[..., Plan]
WITHIN_S = 240.0


def wait_for(directory: DataDirectory, name: str, fulfils: Callable[[ProcessRecord], bool]) -> ProcessRecord:
    """Return the record of a process once it fulfils a condition."""
    until = time.monotonic() + WITHIN_S
    while time.monotonic() < until:
        record = directory.read()
        for one in record.processes if record else ():
            if one.name == name and fulfils(one):
                return one
        time.sleep(0.05)
    raise AssertionError(f"{name} did not come so far: {directory.read()}")


def running(record: ProcessRecord) -> bool:
    """Whether a process runs."""
    return record.standing is Standing.RUNNING and record.pid is not None and psutil.pid_exists(record.pid)


def wait_until_gone(pid: int) -> None:
    """Return once a process has ended."""
    until = time.monotonic() + WITHIN_S
    while psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < until, f"process {pid} is still there"
        time.sleep(0.05)


def test_processes_run_and_stop_without_leftovers(
    plan_with: PlanMaker, options: Options, directory: DataDirectory
) -> None:
    """Everything of the plan runs after `start`, and nothing of it after `stop`."""
    start(plan_with(one=FOREVER, two=FOREVER), options, directory)
    pids = [wait_for(directory, name, running).pid for name in ("router", "one", "two")]
    assert stop(directory)
    assert not any(psutil.pid_exists(pid) for pid in pids if pid)
    assert directory.read() is None
    assert not stop(directory)


def test_a_killed_process_is_started_again(plan_with: PlanMaker, options: Options, directory: DataDirectory) -> None:
    """A process that ends by kill -9 comes back with a new process id, and the others stay."""
    start(plan_with(one=FOREVER, two=FOREVER), options, directory)
    before = wait_for(directory, "one", running)
    other = wait_for(directory, "two", running)
    assert before.pid is not None
    os.kill(before.pid, signal.SIGKILL)
    after = wait_for(directory, "one", lambda r: running(r) and r.pid != before.pid)
    assert (after.restarts, after.exit_code) == (1, -signal.SIGKILL)
    assert wait_for(directory, "two", running).pid == other.pid


@pytest.mark.parametrize("code", [69, 78])
def test_a_process_that_cannot_run_is_given_up(
    plan_with: PlanMaker, options: Options, directory: DataDirectory, code: int
) -> None:
    """Exit codes that say "already alive" and "wrong settings" end the attempts, and the others go on."""
    start(plan_with(bad=f"raise SystemExit({code})", good=FOREVER), options, directory)
    given_up = wait_for(directory, "bad", lambda r: r.standing is Standing.GIVEN_UP)
    assert (given_up.exit_code, given_up.restarts) == (code, 0)
    wait_for(directory, "good", running)


def test_children_die_with_a_killed_supervisor(
    plan_with: PlanMaker, options: Options, directory: DataDirectory
) -> None:
    """After kill -9 of the supervisor nothing of the site is left, and a new one can start."""
    record = start(plan_with(one=STUBBORN), options, directory)
    pids = [wait_for(directory, name, running).pid for name in ("router", "one")]
    os.kill(record.supervisor_pid, signal.SIGKILL)
    for pid in pids:
        assert pid is not None
        wait_until_gone(pid)
    assert directory.read() is None
    start(plan_with(one=FOREVER), options, directory)
    wait_for(directory, "one", running)


def test_a_second_start_says_that_the_site_is_up(
    plan_with: PlanMaker, options: Options, directory: DataDirectory
) -> None:
    """The second start changes nothing and names the commands that help."""
    start(plan_with(one=FOREVER), options, directory)
    before = wait_for(directory, "one", running)
    with pytest.raises(CliError, match=r"already.*muster down"):
        start(plan_with(one=FOREVER), options, directory)
    assert wait_for(directory, "one", running).pid == before.pid


def test_files_that_a_crash_left_behind_do_not_count(
    plan_with: PlanMaker, options: Options, directory: DataDirectory
) -> None:
    """A lock file with the id of a living but other process does not keep a site from starting."""
    directory.root.mkdir()
    (directory.root / "site.lock").write_text(str(os.getpid()))
    (directory.root / "site.json").write_text("{")
    assert directory.read() is None
    start(plan_with(one=FOREVER), options, directory)
    wait_for(directory, "one", running)


@pytest.mark.parametrize(("field", "option"), [("port", "--port"), ("bus_port", "--bus-port")])
def test_a_taken_port_is_refused(
    plan_with: PlanMaker, options: Options, directory: DataDirectory, field: str, option: str
) -> None:
    """Nothing is started, and the message names the port and the option that changes it."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", getattr(options, field)))
        taken.listen()
        with pytest.raises(CliError, match=f"{getattr(options, field)}.*{option}"):
            start(plan_with(one=FOREVER), options, directory)
    assert not directory.held()
