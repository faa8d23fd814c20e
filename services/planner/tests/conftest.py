"""One router for all tests here; each planner has a site's name of its own on it, so none hears another."""

from collections.abc import Generator

import pytest
from muster_bus.testing import RouterProcess, running_router


@pytest.fixture(scope="session")
def shared_router() -> Generator[RouterProcess]:
    """Provide a router that no test may harm."""
    with running_router() as process:
        yield process
