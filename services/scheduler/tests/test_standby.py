"""Two scheduler processes on one real PostgreSQL: the second stands by, and takes over when the first one is gone."""

import contextlib
import signal
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from pathlib import Path

import pytest
from muster_bus import Bus, NoReplyError
from muster_bus.testing import Process, RouterProcess, eventually, running_bus, service_process
from muster_scheduler.testing import planned, yard_file
from muster_scheduler.testing_agents import SimulatedAgent, crew
from muster_scheduler.testing_postgres import PostgresServer
from muster_schemas.channels import MISSIONS, SUBMIT
from muster_schemas.mission import MissionStatus, MissionView
from muster_schemas.plan import Plan
from muster_schemas.rpc import ControlReply, MissionsQuery, MissionsReply, SubmitMission
from muster_schemas.site import load_site

SITE = load_site(yard_file())
E1, T1 = "robot_excavator_01", "robot_dump_truck_01"
GO, DIG = "target_area_for_specific_robots", "Excavation"
WITHIN_S = 120


@dataclass
class Pair:
    """An active scheduler and one that stands by, with two robots."""

    bus: Bus
    agents: dict[str, SimulatedAgent]
    url: str
    active: Process
    standby: Process

    async def submit(self) -> str:
        """Make a mission of a drive and a dig and return its id."""
        drive = planned("drive", GO, [E1, T1], objects=["soil1"])
        plan = Plan(tasks=(drive, planned("dig", DIG, [E1], after=["drive"])))
        reply: ControlReply = await self.bus.ask(SUBMIT, SubmitMission(text="dig", plan=plan), timeout_s=30)
        return reply.mission_id

    async def ended(self, mission_id: str) -> MissionView:
        """Wait for the end of a mission, whichever scheduler brings it there."""

        async def look() -> MissionView | None:
            with contextlib.suppress(NoReplyError):
                query = MissionsQuery(mission_id=mission_id)
                reply: MissionsReply = await self.bus.ask(MISSIONS, query, timeout_s=5)
                return reply.missions[0] if reply.missions[0].mission.state.ended else None
            return None

        view = await eventually(look, WITHIN_S)
        assert view is not None
        return view

    def starts(self) -> list[int]:
        """Return how often each attempt was started."""
        return [n for a in self.agents.values() for n in a.started.values()]


@pytest.fixture
async def pair(router: RouterProcess, postgres: PostgresServer, tmp_path: Path) -> AsyncGenerator[Pair]:
    """Provide two schedulers with one database; the second has said that it stands by."""
    url = postgres.database()
    async with contextlib.AsyncExitStack() as stack:
        bus = await stack.enter_async_context(running_bus(router))
        agents = await stack.enter_async_context(crew(bus, SITE, (E1, T1)))
        processes: list[Process] = []
        for name, event in (("one", "serving"), ("two", "standing_by")):
            env = {"MUSTER_DATA_DIR": str(tmp_path / name), "MUSTER_DATABASE_URL": url}
            process = service_process("muster_scheduler", router, env, wait=False)
            processes.append(await stack.enter_async_context(process))
            await processes[-1].until_logged(event, WITHIN_S)
        yield Pair(bus, agents, url, *processes)


async def test_the_standby_finishes_what_a_killed_scheduler_began(pair: Pair) -> None:
    """After kill -9 in the middle of a mission the other takes over in a new epoch, and nothing is started twice."""
    pair.agents[E1].hold.clear()
    mission_id = await pair.submit()
    await eventually(lambda: pair.agents[E1].started)
    assert not pair.standby.logged("serving")
    await pair.active.kill()
    await pair.standby.until_logged("serving", WITHIN_S)
    pair.agents[E1].hold.set()
    view = await pair.ended(mission_id)
    assert view.mission.state is MissionStatus.SUCCEEDED
    assert set(pair.starts()) == {1}
    assert max(r.epoch for r in pair.agents[E1].requests) == 2


async def test_a_scheduler_that_is_cut_off_from_the_database_ends_itself(pair: Pair, postgres: PostgresServer) -> None:
    """Its session is gone, and with it the lock; it stops at once and the standby goes on with the mission."""
    pair.agents[E1].hold.clear()
    mission_id = await pair.submit()
    await eventually(lambda: pair.agents[E1].started)
    postgres.end_sessions(pair.url)
    assert await pair.active.ended(WITHIN_S) == 1
    assert "lost the database" in pair.active.output
    await pair.standby.until_logged("serving", WITHIN_S)
    pair.agents[E1].hold.set()
    view = await pair.ended(mission_id)
    assert view.mission.state is MissionStatus.SUCCEEDED
    assert set(pair.starts()) == {1}


async def test_a_scheduler_that_stood_still_finds_its_lease_over(pair: Pair) -> None:
    """The database ends its session, the standby takes over, and when it wakes it ends itself without harm."""
    pair.agents[E1].hold.clear()
    mission_id = await pair.submit()
    await eventually(lambda: pair.agents[E1].started)
    pair.active.signal(signal.SIGSTOP)
    await pair.standby.until_logged("serving", WITHIN_S)
    pair.active.signal(signal.SIGCONT)
    assert await pair.active.ended(WITHIN_S) != 0
    pair.agents[E1].hold.set()
    view = await pair.ended(mission_id)
    assert view.mission.state is MissionStatus.SUCCEEDED
    assert set(pair.starts()) == {1}


async def test_a_standby_ends_when_asked_to(pair: Pair) -> None:
    """It has nothing to drain, and the active one does not notice."""
    assert await pair.standby.terminate() == 0
    assert pair.active.exit_code is None
    assert set(pair.starts()) <= {1}
