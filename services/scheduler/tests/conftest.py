"""A site in memory for the tests of the core, and a real PostgreSQL for those of the store."""

from collections.abc import Iterator

import pytest
from muster_scheduler.testing import Yard, yard_file
from muster_scheduler.testing_postgres import PostgresServer, running_postgres
from muster_schemas.site import load_site


@pytest.fixture
def yard() -> Yard:
    """Provide the default site with all robots and objects seen; invariants are checked after every event."""
    yard = Yard(load_site(yard_file()))
    yard.open()
    return yard


@pytest.fixture(scope="session")
def postgres() -> Iterator[PostgresServer]:
    """Provide a PostgreSQL server; each test makes databases of its own in it."""
    with running_postgres() as server:
        yield server
