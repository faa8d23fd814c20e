"""Commit, publish, answer: what happens to the rest when one step does not work."""

import resource
import time
from collections.abc import AsyncGenerator
from pathlib import Path

import pytest
from muster_bus.testing import RouterProcess, running_bus
from muster_scheduler.core.errors import NotPossibleError
from muster_scheduler.core.events import MissionSubmitted, Policy, SelectorBound
from muster_scheduler.engine import Engine, Wish
from muster_scheduler.journal import Journal, JournalUnavailableError
from muster_scheduler.outbox import Outbox
from muster_scheduler.policy.world import World
from muster_scheduler.recovery import replay
from muster_scheduler.sightings import Sightings
from muster_scheduler.testing import planned, yard_file
from muster_schemas.site import load_site

SITE = load_site(yard_file())


@pytest.fixture
async def engine(router: RouterProcess, tmp_path: Path) -> AsyncGenerator[Engine]:
    """Provide a started engine on a real journal and a real bus."""
    journal = Journal.open(tmp_path, SITE.name)
    async with running_bus(router) as bus:
        sightings = Sightings(World(bounds=SITE.bounds), time.monotonic())
        engine = Engine(replay(journal), journal, Outbox(bus), sightings)
        engine.start(SITE.skills, Policy())
        yield engine
    journal.close()


def submit(engine: Engine, mission_id: str) -> Wish:
    """Return the wish for a mission of one task."""
    task = planned("dig", "Excavation", ["robot_excavator_01"])
    return Wish(MissionSubmitted(at=engine.now(), mission_id=mission_id, text="dig", tasks=(task,)))


async def test_a_full_disk_refuses_what_cannot_be_written_and_forgets_nothing_else(engine: Engine) -> None:
    """The caller is told, nothing is half done, and when there is room again everything goes on."""
    first = submit(engine, "m1")
    engine.step([first])
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, limits[1]))
    try:
        second = submit(engine, "m2")
        engine.step([second])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    with pytest.raises(JournalUnavailableError):
        second.done.result(0)
    assert list(engine.core.state.missions) == ["m1"]
    third = submit(engine, "m3")
    engine.step([third])
    third.done.result(0)
    assert list(engine.core.state.missions) == ["m1", "m3"]


async def test_one_bad_event_does_not_take_the_others_of_its_batch_with_it(engine: Engine) -> None:
    """A bug in one handler costs that event only; a wish that cannot be is refused with its reason."""
    good, again, broken, late = (
        submit(engine, "m1"),
        submit(engine, "m1"),
        Wish(SelectorBound(at=engine.now(), mission_id="m-none", selector="x", robots=("r1",))),
        submit(engine, "m2"),
    )
    engine.step([good, again, broken, late])
    good.done.result(0)
    late.done.result(0)
    with pytest.raises(NotPossibleError):
        again.done.result(0)
    with pytest.raises(KeyError):
        broken.done.result(0)
    assert list(engine.core.state.missions) == ["m1", "m2"]
