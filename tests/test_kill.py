"""kill -9 of any process in the middle of a mission: it ends properly all the same, and nothing is run twice."""

import asyncio
from collections import Counter
from collections.abc import Iterator

import pytest
from muster_bus import open_bus
from muster_bus.testing import eventually
from muster_schemas.mission import TaskStatus

from tests.running_site import (
    RunningSite,
    describe,
    order_problems,
    plan_of_case,
    running_site,
    submit,
    succeeded,
    until_ended,
)

pytestmark = [pytest.mark.end_to_end, pytest.mark.timeout(1800)]

CASE = "A-L2-004"
"""Excavator 3 loads truck 2 at soil2, the truck hauls it to the rock and tips."""
EXCAVATOR = "robot_excavator_03"
WITHIN_S = 600.0


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSite]:
    """Run the default site under its supervisor."""
    with running_site(tmp_path_factory.mktemp("site"), speed=4) as running:
        yield running


async def under_way(site: RunningSite, mission_id: str) -> None:
    """Wait until a machine has begun something."""
    await eventually(lambda: site.history(mission_id), within_s=300)


def started_twice(site: RunningSite, mission_id: str) -> list[object]:
    """Return the attempts that a robot physically began more than once."""
    starts = Counter((e.task_id, e.attempt, e.robot_id) for e in site.history(mission_id) if e.event == "start")
    return [key for key, count in starts.items() if count > 1]


@pytest.mark.parametrize("process", ["scheduler", "planner", "vision", "router"])
async def test_a_mission_succeeds_although_a_process_is_killed(site: RunningSite, process: str) -> None:
    """These come back and know what was going on; robots carry on meanwhile."""
    await site.ready()
    async with open_bus("yard", [site.endpoint]) as bus:
        mission_id = await submit(bus, f"kill {process}", plan_of_case(CASE))
        await under_way(site, mission_id)
        await asyncio.to_thread(site.kill, process)
        view = await until_ended(bus, mission_id, WITHIN_S)
    assert succeeded(view), describe(view)
    assert order_problems(view, site.history(mission_id)) == []


async def test_a_killed_robot_agent_stops_its_machine_and_never_starts_an_attempt_again(site: RunningSite) -> None:
    """What it was doing counts as interrupted: a new attempt or a failure with its reason, never the same one again."""
    await site.ready()
    async with open_bus("yard", [site.endpoint]) as bus:
        mission_id = await submit(bus, "kill the agent", plan_of_case(CASE))
        begun = await site.kill_at_work(EXCAVATOR, mission_id)
        view = await until_ended(bus, mission_id, WITHIN_S)
    assert started_twice(site, mission_id) == []
    [hit] = [t for t in view.tasks if t.task_id == begun.task_id]
    assert hit.attempt > begun.attempt or (hit.state is TaskStatus.FAILED and hit.error), describe(view)
    assert all(t.error for t in view.tasks if t.state is TaskStatus.FAILED), describe(view)


async def test_a_killed_simulator_fails_nothing_silently(site: RunningSite) -> None:
    """The machines are back at home with a fresh ground; the mission ends, and each task says how."""
    await site.ready()
    async with open_bus("yard", [site.endpoint]) as bus:
        mission_id = await submit(bus, "kill the simulator", plan_of_case(CASE))
        await under_way(site, mission_id)
        await asyncio.to_thread(site.kill, "sim")
        view = await until_ended(bus, mission_id, WITHIN_S)
    assert started_twice(site, mission_id) == []
    assert all(t.state.ended for t in view.tasks), describe(view)
    assert succeeded(view) or any(t.error for t in view.tasks), describe(view)
