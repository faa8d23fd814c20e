"""The command line as an operator meets it: clear lines, exit codes, no tracebacks."""

import subprocess
import sys
from pathlib import Path

import pytest


def muster(tmp_path: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command with a data directory of its own."""
    env = {"MUSTER_DATA_DIR": str(tmp_path / "data"), "COLUMNS": "120", **environment}
    return subprocess.run(
        [sys.executable, "-m", "muster_cli", *arguments],
        capture_output=True,
        text=True,
        env=env,
        check=False,
        timeout=280,
    )


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("run", "dig"), "muster up"),
        (("missions",), "muster up"),
        (("cancel", "m-1"), "muster up"),
        (("status",), "muster up"),
        (("cancel", "M*"), "a-z"),
        (("run", " "), "empty"),
        (("run", "x" * 3000), "at most 2000"),
        (("plan",), "--batch"),
        (("plan", "dig", "--site", "nowhere.yaml"), "nowhere.yaml"),
        (("up", "--site", "nowhere.yaml"), "nowhere.yaml"),
    ],
)
def test_a_mistake_is_one_clear_line(tmp_path: Path, arguments: tuple[str, ...], says: str) -> None:
    """It goes to standard error, says what to do, and the exit code is not 0."""
    done = muster(tmp_path, *arguments, MUSTER_URL="http://127.0.0.1:9")
    assert done.returncode in (1, 2)
    assert done.stdout == ""
    assert says in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_setting_that_cannot_be_is_named(tmp_path: Path) -> None:
    """The message has the variable's name."""
    done = muster(tmp_path, "status", MUSTER_LOG_LEVEL="loud")
    assert done.returncode == 2
    assert "MUSTER_LOG_LEVEL" in done.stderr


def test_monitor_without_a_router_says_so(tmp_path: Path) -> None:
    """It does not wait for ever."""
    done = muster(tmp_path, "monitor", "--plain", MUSTER_CONNECT="tcp/127.0.0.1:9")
    assert done.returncode == 1
    assert "tcp/127.0.0.1:9" in done.stderr


def test_down_without_a_site_is_no_error(tmp_path: Path) -> None:
    """There is nothing to do, and it says so."""
    done = muster(tmp_path, "down")
    assert done.returncode == 0
    assert "No site is up" in done.stdout
