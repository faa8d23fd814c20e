"""Many kinematic robots in one process."""

import asyncio
import time
from pathlib import Path

import pytest
from muster_bus import Bus
from muster_bus.settings import BAD_SETTINGS_EXIT
from muster_bus.testing import Process, RouterProcess, eventually, running_bus
from muster_robot_agent.drivers.kinematic_world import KinematicWorld
from muster_robot_agent.host import chosen
from muster_robot_agent.machine import Order
from muster_schemas.channels import ROBOT_ALIVE, ROBOT_CARD, SKILL_REQUEST, SKILL_STATUS
from muster_schemas.robot import RobotCard, SkillRequest, SkillStatusKind
from muster_schemas.site import Site

E1, T1, T2, T3 = "robot_excavator_01", "robot_dump_truck_01", "robot_dump_truck_02", "robot_dump_truck_03"
WITHIN_S = 120.0


def test_robots_are_chosen_by_name_by_range_or_all(site: Site) -> None:
    """A range goes in the order of the site's file."""
    assert chosen("all", site) == tuple(r.id for r in site.robots)
    assert chosen(f"{T1}..{T3}", site) == (T1, T2, T3)
    assert chosen(f"{T3}, {E1}", site) == (T3, E1)


@pytest.mark.parametrize("wanted", ["", "robot_nobody", f"{T1}..", f"{T3}..{T1}", f"{T1},{T1}"])
def test_a_choice_that_means_nothing_is_an_error(wanted: str, site: Site) -> None:
    """Nobody is guessed, and nobody is left out."""
    with pytest.raises(ValueError, match=r"robot|range|twice"):
        chosen(wanted, site)


async def test_a_host_without_such_a_robot_says_so_and_does_not_start(router: RouterProcess, tmp_path: Path) -> None:
    """The exit code is that of unusable settings."""
    env = {**router.environment, "MUSTER_DATA_DIR": str(tmp_path)}
    process = Process("muster_robot_agent.host", env, "--robots", "robot_nobody")
    try:
        assert await process.ended(WITHIN_S) == BAD_SETTINGS_EXIT
        assert "robot_nobody" in process.output
    finally:
        process.dispose()


async def test_one_process_is_the_agent_of_each_robot(router: RouterProcess, site: Site, tmp_path: Path) -> None:
    """Each has its own token, card and journal; the one that is asked answers, and ends with the process."""
    env = {**router.environment, "MUSTER_DATA_DIR": str(tmp_path)}
    process = Process("muster_robot_agent.host", env, "--robots", f"{T1}..{T3}")
    cards: dict[str, RobotCard] = {}
    words: dict[str, list[SkillStatusKind]] = {}
    try:
        async with (
            running_bus(router) as bus,
            bus.subscribe(ROBOT_CARD) as said_cards,
            bus.subscribe(SKILL_STATUS) as said,
        ):

            async def hear_cards() -> None:
                async for received in said_cards:
                    if received.message is not None:
                        cards[received.message.robot_id] = received.message

            async def hear() -> None:
                async for received in said:
                    if received.message is not None:
                        words.setdefault(received.message.robot_id, []).append(received.message.state)

            hearing = [asyncio.create_task(hear_cards()), asyncio.create_task(hear())]
            await eventually(lambda: len(cards) == 3, WITHIN_S)
            assert {ids["robot_id"] for ids in await bus.who_is_alive(ROBOT_ALIVE)} == {T1, T2, T3}
            request = SkillRequest(
                mission_id="m-1",
                task_id="t1",
                attempt=1,
                epoch=1,
                robot_id=T2,
                boot_id=cards[T2].boot_id,
                skill="dump_unloading",
                issued_at=time.time(),
                deadline=time.time() + WITHIN_S,
            )

            def answered() -> bool:
                # sent again like a scheduler's, since the agent may not have subscribed yet
                bus.publish(SKILL_REQUEST, request, robot_id=T2, skill=request.skill)
                return SkillStatusKind.SUCCEEDED in words.get(T2, ())

            await eventually(answered, WITHIN_S)
            assert set(words) == {T2}
            assert await process.terminate() == 0
            await eventually(lambda: _nobody(bus), WITHIN_S)
            for task in hearing:
                task.cancel()
            await asyncio.gather(*hearing, return_exceptions=True)
    finally:
        process.dispose()
    assert _journals(tmp_path) == {f"agent-{r}.sqlite3" for r in (T1, T2, T3)}


def _journals(folder: Path) -> set[str]:
    return {p.name for p in folder.glob("agent-*.sqlite3")}


async def _nobody(bus: Bus) -> bool:
    return not await bus.who_is_alive(ROBOT_ALIVE)


def test_a_machine_at_rest_costs_nothing_until_it_is_told_to_move(site: Site) -> None:
    """Only machines that may change are looked at by the world."""
    world = KinematicWorld(site, [T1, T2])
    assert world.advance() == []
    world.command(T1, Order(speed_mps=1.0))
    moved = [world.advance() for _ in range(200)]
    assert moved[0] == [T1]
    assert moved[-1] == []  # halted by the command timeout, and at rest since
    assert world.telemetry(T1).speed_mps == 0
    assert world.telemetry(T1).pose.x > world.robots[T2].pose.x
