"""Agents with the real simulator: soil goes from a pile by bucket into a bed and into a puddle. Real processes."""

import contextlib
from pathlib import Path

import pytest
from muster_bus.testing import SITE_FILE, RouterProcess, eventually, service_process
from muster_robot_agent.testing import map_object, target
from muster_schemas.channels import OBJECT, SIM_WORLD
from muster_schemas.robot import RobotCard, SkillStatusKind
from muster_schemas.sim import SimWorld
from muster_schemas.site import load_site

from .test_agent import GO, MODULE, Listener, listening

E1, T1 = "robot_excavator_01", "robot_dump_truck_01"


async def do(scheduler: Listener, task: str, card: RobotCard, skill: str, **rest: object) -> None:
    """Ask for a skill and wait for the first answer; `done` waits for its end."""
    fields: dict[str, object] = {"goals": [], **rest}
    scheduler.ask(card, task_id=task, skill=skill, **fields)
    await eventually(lambda: scheduler.states_of(task), 240)


async def done(scheduler: Listener, *tasks: str) -> None:
    """Wait for tasks to succeed; a failed one is shown with its reason."""
    for task in tasks:
        await eventually(lambda name=task: any(s.state.final for s in scheduler.statuses if s.task_id == name), 600)
        final = next(s for s in scheduler.statuses if s.task_id == task and s.state.final)
        assert final.state is SkillStatusKind.SUCCEEDED, final.reason
        scheduler.acknowledge(final)


async def truth(scheduler: Listener) -> SimWorld:
    """Return the simulator's next word on how things are."""
    async with scheduler.bus.subscribe(SIM_WORLD) as messages:
        async for received in messages:
            if received.message is not None:
                return received.message
    raise AssertionError("the simulator says nothing")


async def test_soil_goes_from_pile_to_puddle(router: RouterProcess, tmp_path: Path) -> None:
    """Excavator and truck drive up, dig, load, haul, tip and clear an obstacle; the truth agrees and nobody touched."""
    things = {t.name: map_object(t) for t in load_site(SITE_FILE).things}
    soil, puddle, obstacle = (target(things[n]) for n in ("soil1", "puddle1", "obstacle1"))
    async with contextlib.AsyncExitStack() as stack:
        scheduler = await stack.enter_async_context(listening(router))
        await stack.enter_async_context(service_process("muster_sim", router, {"MUSTER_SPEED_FACTOR": "6"}))
        for robot in (E1, T1):
            settings = {"MUSTER_ROBOT_ID": robot, "MUSTER_DATA_DIR": str(tmp_path)}
            await stack.enter_async_context(service_process(MODULE, router, settings))
        for thing in things.values():
            scheduler.bus.publish(OBJECT, thing, object_name=thing.name)
        digger, truck = await scheduler.card(E1), await scheduler.card(T1)

        await do(scheduler, "t1", digger, GO, objects=[soil], goals=[{"x": -10, "y": 7, "yaw": 1.57}])
        await do(scheduler, "t2", truck, GO, objects=[soil], goals=[{"x": -15.2, "y": 8.5, "yaw": -2.4}])
        await done(scheduler, "t1", "t2")
        await do(scheduler, "t3", digger, "excavator_digging", objects=[soil])
        await done(scheduler, "t3")
        await do(scheduler, "t4", truck, "dump_loading", objects=[soil], partner=E1)
        await do(scheduler, "t5", digger, "excavator_unloading", objects=[soil], partner=T1)
        await done(scheduler, "t4", "t5")
        world = await truth(scheduler)
        assert world.robots[T1].load.soil_m3 == pytest.approx(0.5, abs=0.01)

        await do(scheduler, "t6", truck, "dump_unloading", objects=[puddle], goals=[{"x": -9, "y": -6.5, "yaw": 1.57}])
        beside = [{"x": -3, "y": 5, "yaw": -1.57}]
        await do(scheduler, "t7", digger, "excavator_digging", objects=[obstacle], goals=beside)
        await done(scheduler, "t6", "t7")
        world = await truth(scheduler)
        assert world.robots[T1].load.empty
        assert world.robots[E1].load.bodies == ("obstacle1",)
        assert min(d.position.distance(puddle.position) for d in world.soil) < 0.5
        assert world.robot_contacts == 0
