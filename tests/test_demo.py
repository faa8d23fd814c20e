"""`muster demo`, as `make demo` runs it: the real planner, the real site, one instruction, judged by the soil."""

import subprocess
import sys
from pathlib import Path

import pytest
from muster_bus.settings import child_environment
from muster_bus.testing import SITE_FILE
from muster_cli.record import DataDirectory


@pytest.mark.end_to_end
@pytest.mark.timeout(2400)
def test_the_demo_moves_the_soil_and_leaves_nothing_behind(tmp_path: Path) -> None:
    """It ends with exit code 0, shows its timeline, and its site is down afterwards."""
    settings = {"MUSTER_DATA_DIR": str(tmp_path / "data"), "MUSTER_SITE_FILE": str(SITE_FILE), "COLUMNS": "120"}
    done = subprocess.run(
        [sys.executable, "-m", "muster_cli", "demo", "--speed", "8"],
        env=child_environment(settings),
        capture_output=True,
        text=True,
        check=False,
        timeout=2100,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "The soil is where it belongs." in done.stdout
    assert "━" in done.stdout
    assert not DataDirectory(tmp_path / "data" / "demo").held()
