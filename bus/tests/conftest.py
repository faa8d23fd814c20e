"""One router for all tests that do not harm it; each test has a site of its own on it, so none hears another."""

import itertools
import json
from collections.abc import Generator
from pathlib import Path

import pytest
import zenoh
from muster_bus.testing import RouterProcess, running_router

_numbers = itertools.count(1)


@pytest.fixture(scope="session")
def shared_router() -> Generator[RouterProcess]:
    """Provide a router that no test may harm."""
    with running_router() as process:
        yield process


@pytest.fixture
def site() -> str:
    """Provide a site's name that no other test has."""
    return f"site-{next(_numbers)}"


@pytest.fixture
def stranger(shared_router: RouterProcess) -> Generator[zenoh.Session]:
    """Provide a plain Zenoh session, as any other program on the network may open."""
    with zenoh.open(plain_config(shared_router)) as session:
        yield session


def plain_config(router: RouterProcess) -> zenoh.Config:
    """Return the configuration of a program that knows nothing of Muster."""
    settings = {
        "mode": "client",
        "connect": {"endpoints": [router.endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}},
    }
    return zenoh.Config.from_json5(json.dumps(settings))


@pytest.fixture
def programs() -> dict[str, str]:
    """Provide the environment in which the test's own programs are found."""
    return {"PYTHONPATH": str(Path(__file__).parent / "programs")}
