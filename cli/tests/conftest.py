"""Sites of small real processes, for the supervisor's tests."""

import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from muster_cli.launch import stop
from muster_cli.processes import Options, Plan, Process
from muster_cli.record import DataDirectory


@pytest.fixture
def free_port() -> Callable[[], int]:
    """Return a function that gives a port nobody listens on."""

    def find() -> int:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            return int(probe.getsockname()[1])

    return find


@pytest.fixture
def directory(tmp_path: Path) -> Iterator[DataDirectory]:
    """Return a data directory whose site is stopped after the test."""
    found = DataDirectory(tmp_path / "data")
    yield found
    stop(found)


@pytest.fixture
def options(tmp_path: Path, free_port: Callable[[], int]) -> Options:
    """Return options with ports of their own."""
    return Options(
        site_file=Path("sites/yard.yaml"),
        data_dir=tmp_path / "data",
        bus_port=free_port(),
        port=free_port(),
        speed_factor=1.0,
        driver="sim",
        planner="embedded",
        log_level="warning",
    )


@pytest.fixture
def plan_with(options: Options) -> Callable[..., Plan]:
    """Return a function that makes a plan of the real router and of processes that run the given Python code."""

    def make(**code: str) -> Plan:
        endpoint = f"tcp/127.0.0.1:{options.bus_port}"
        return Plan(
            site="yard",
            site_file="sites/yard.yaml",
            endpoint=endpoint,
            url=f"http://127.0.0.1:{options.port}",
            speed_factor=1.0,
            driver="sim",
            planner="embedded",
            first=Process(
                name="router", argv=(sys.executable, "-m", "muster_bus.router"), env={"MUSTER_LISTEN": endpoint}
            ),
            rest=tuple(Process(name=name, argv=(sys.executable, "-c", text)) for name, text in code.items()),
        )

    return make
