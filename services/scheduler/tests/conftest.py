"""A site in memory for the tests of the core."""

import pytest
from muster_scheduler.testing import Yard, yard_file
from muster_schemas.site import load_site


@pytest.fixture
def yard() -> Yard:
    """Provide the default site with all robots and objects seen; invariants are checked after every event."""
    yard = Yard(load_site(yard_file()))
    yard.open()
    return yard
