"""Malformed plans of every kind against a scheduler process: refused with reasons, and no robot hears of any."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from muster_bus import RefusedError
from muster_bus.testing import RouterProcess, eventually, running_bus, service_process
from muster_scheduler.testing import planned, yard_file
from muster_scheduler.testing_agents import crew
from muster_schemas.channels import SUBMIT, Channel
from muster_schemas.plan import Plan
from muster_schemas.rpc import ControlReply, ErrorCode, SubmitMission
from muster_schemas.site import load_site
from pydantic import BaseModel

SITE = load_site(yard_file())
E1, T1 = "robot_excavator_01", "robot_dump_truck_01"
GO, DIG = "target_area_for_specific_robots", "Excavation"
ASK_S = 30


class Anything(BaseModel):
    """A submission as some other program may send it."""

    text: str
    plan: Any


def task(name: str = "a", skill: str = DIG, **fields: Any) -> dict[str, Any]:
    """Return one task as JSON."""
    return {"task": name, "instruction_function": {"name": skill, "robot_ids": [E1], **fields}}


def plan(*tasks: dict[str, Any]) -> dict[str, Any]:
    """Return a plan as JSON."""
    return {"tasks": list(tasks)}


MALFORMED: dict[str, Any] = {
    "a cycle of two": plan(task(dependencies=["b"]), task("b", dependencies=["a"])),
    "a cycle of three": plan(task(dependencies=["c"]), task("b", dependencies=["a"]), task("c", dependencies=["b"])),
    "a task that waits for itself": plan(task(dependencies=["a"])),
    "a dangling dependency": plan(task(dependencies=["z"])),
    "two tasks of one name": plan(task(), task()),
    "no task": plan(),
    "too many tasks": plan(*(task(f"n{i}") for i in range(101))),
    "an unknown robot": plan(task(robot_ids=["robot_excavator_99"])),
    "a robot twice": plan(task(robot_ids=[E1, E1])),
    "no robot": plan(task(robot_ids=[])),
    "an unknown type": plan(task(robot_ids=[], robot_type=["crane"], robot_count=1)),
    "more robots than there are": plan(task(robot_ids=[], robot_type=["excavator"], robot_count=4)),
    "no robots at all": plan(task(robot_ids=[], robot_type=["excavator"], robot_count=0)),
    "a count that is no number": plan(task(robot_ids=[], robot_type=["excavator"], robot_count="many")),
    "an unknown skill": plan(task(skill="fly")),
    "a skill that the robot lacks": plan(task(robot_ids=[T1])),
    "an unknown object": plan(task(skill=GO, object_keywords=["castle1"])),
    "no object where one is needed": plan(task(skill=GO)),
    "an object where none is taken": plan(task(skill="return_to_start_for_specific_robots", object_keywords=["soil1"])),
    "a key in place of an object": plan(task(skill=GO, object_keywords=["../**"])),
    "a fleet-wide skill without all robots": plan(task(skill="return_to_start_for_all_robots")),
    "tasks that are no list": {"tasks": 5},
    "a task that is a number": {"tasks": [7]},
    "a task without a function": {"tasks": [{"task": "a"}]},
    "a name that is a list": {"tasks": [{**task(), "task": ["a"]}]},
    "a policy that there is not": {"tasks": [{**task(), "on_failure": {"then": ["panic"]}}]},
    "no plan at all": "dig",
}


async def test_no_malformed_plan_reaches_a_robot(router: RouterProcess, tmp_path: Path) -> None:
    """Each is refused with what is wrong; the first request that any robot gets is of the good plan after them."""
    loose: Channel[Any] = replace(SUBMIT, model=Anything)
    env = {"MUSTER_DATA_DIR": str(tmp_path)}
    async with (
        running_bus(router) as bus,
        crew(bus, SITE) as agents,
        service_process("muster_scheduler", router, env) as process,
    ):
        await process.until_logged("serving")
        for what, malformed in MALFORMED.items():
            with pytest.raises(RefusedError) as refused:
                await bus.ask(loose, Anything(text=what, plan=malformed), timeout_s=ASK_S)
            assert refused.value.error.code is ErrorCode.INVALID, what
            assert refused.value.error.message, what
        good = SubmitMission(text="dig", plan=Plan(tasks=(planned("dig", DIG, [E1]),)))
        reply: ControlReply = await bus.ask(SUBMIT, good, timeout_s=ASK_S)
        await eventually(lambda: agents[E1].requests, within_s=60)
        assert {r.mission_id for a in agents.values() for r in a.requests} == {reply.mission_id}
