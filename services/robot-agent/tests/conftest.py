"""The default site, and sites made for one test."""

from collections.abc import Callable, Sequence

import pytest
from muster_bus.testing import SITE_FILE
from muster_robot_agent.testing import Crew
from muster_schemas.site import Site, load_site

MakeCrew = Callable[..., Crew]


@pytest.fixture(scope="session")
def site() -> Site:
    """Provide the default site."""
    return load_site(SITE_FILE)


@pytest.fixture
def crew(site: Site) -> MakeCrew:
    """Provide a maker of crews: robots by short names such as E1 and T2, on the default site or among other things."""

    def make(*names: str, things: Sequence[dict[str, object]] | None = None, states_every_s: float = 0.2) -> Crew:
        ids = [r.id for r in site.robots if _short(r.id) in names]
        place = site
        if things is not None:
            fields = {**site.model_dump(by_alias=True), "things": things}
            place = Site.model_validate(fields)
        return Crew(place, ids, states_every_s=states_every_s)

    return make


def _short(robot_id: str) -> str:
    return ("E" if "excavator" in robot_id else "T") + robot_id[-1]
