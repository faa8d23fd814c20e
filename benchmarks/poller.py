"""The same graph by Muster's scheduler and by a scheduler that looks once a second.

The authors' node and RobotFleet's executor both look by a timer of one second which tasks have all of their
dependencies done, start those, and sleep again. `_poll` does just that and nothing else (no journal, no gate), over the
same bus with the same simulated robots, so what differs is when a task is started after the one before it has ended.
Makespans are from the first start to the last end, as the robots themselves note them.
"""

import asyncio
import tempfile
import time
from collections.abc import Mapping
from typing import Any, Final

from muster_bus import Bus
from muster_bus.testing import RouterProcess, running_bus, running_router, service_process
from muster_scheduler.testing import planned, yard_file
from muster_scheduler.testing_agents import SimulatedAgent, crew
from muster_schemas.channels import MISSIONS, SKILL_REQUEST, SKILL_STATUS, SUBMIT
from muster_schemas.plan import Plan, PlanTask
from muster_schemas.robot import RequestAction, SkillRequest, SkillStatusKind
from muster_schemas.rpc import ControlReply, MissionsQuery, MissionsReply, SubmitMission
from muster_schemas.site import load_site

POLL_S: Final = 1.0
SITE: Final = load_site(yard_file())
TAKES_S: Final = {"robot_excavator_01": 0.7, "robot_excavator_02": 1.2, "robot_excavator_03": 1.6}
"""How long each robot's tasks take, in seconds; no multiples of the poller's."""
LAYERS: Final = 12
WAIT_S: Final = 30.0
POLLED: Final = "m-polled"


def measure() -> list[dict[str, Any]]:
    """Return the makespans of both, and of the graph itself if nothing stood between two tasks."""
    muster_s, poller_s = asyncio.run(_measure())
    ideal_s = _critical_path_s(_graph())
    return [
        _row("poller_makespan_over_ours", poller_s / muster_s, "x"),
        _row("makespan_ours_s", muster_s, "s"),
        _row("makespan_poller_s", poller_s, "s"),
        _row("makespan_without_waits_s", ideal_s, "s"),
    ]


def _row(name: str, value: float, unit: str) -> dict[str, Any]:
    return {"name": name, "value": round(value, 3), "unit": unit, "bar": None, "ok": True}


def _graph() -> list[PlanTask]:
    """Return layers of one task for each robot; each waits for its robot's last one and for its neighbour's."""
    robots = list(TAKES_S)
    tasks: list[PlanTask] = []
    for layer in range(LAYERS):
        for place, robot_id in enumerate(robots):
            before = [f"n{layer - 1}-{p}" for p in (place, (place + 1) % len(robots))] if layer else []
            tasks.append(planned(f"n{layer}-{place}", "Excavation", [robot_id], before))
    return tasks


def _critical_path_s(tasks: list[PlanTask]) -> float:
    ends: dict[str, float] = {}
    for task in tasks:
        function = task.instruction_function
        ends[task.task] = max((ends[d] for d in function.dependencies), default=0.0) + TAKES_S[function.robot_ids[0]]
    return max(ends.values())


async def _measure() -> tuple[float, float]:
    with running_router() as router:
        async with running_bus(router) as bus, crew(bus, SITE, TAKES_S) as agents:
            for robot_id, agent in agents.items():
                agent.takes_s = TAKES_S[robot_id]
            ours = await _ours(bus, router)
            await _polled(bus, agents)
            return _makespan_s(agents, ours), _makespan_s(agents, POLLED)


def _makespan_s(agents: Mapping[str, SimulatedAgent], mission_id: str) -> float:
    times = [at for agent in agents.values() for at, _, request in agent.log if request.mission_id == mission_id]
    return max(times) - min(times)


async def _ours(bus: Bus, router: RouterProcess) -> str:
    """Run the graph by the real scheduler; return the mission's id."""
    with tempfile.TemporaryDirectory() as folder:
        async with service_process("muster_scheduler", router, {"MUSTER_DATA_DIR": folder}) as scheduler:
            await scheduler.until_logged("serving")
            request = SubmitMission(text="measure", plan=Plan(tasks=tuple(_graph())))
            made: ControlReply = await bus.ask(SUBMIT, request, timeout_s=WAIT_S)
            query = MissionsQuery(mission_id=made.mission_id)
            while True:
                reply: MissionsReply = await bus.ask(MISSIONS, query, timeout_s=WAIT_S)
                if reply.missions[0].mission.state.ended:
                    return made.mission_id
                await asyncio.sleep(0.2)


async def _polled(bus: Bus, agents: Mapping[str, SimulatedAgent]) -> None:
    """Run the graph by the poller."""
    completed: set[str] = set()
    async with bus.subscribe(SKILL_STATUS) as statuses:

        async def hear() -> None:
            async for received in statuses:
                if received.message is not None and received.message.state is SkillStatusKind.SUCCEEDED:
                    completed.add(received.message.task_id)

        hearing = asyncio.create_task(hear())
        await _poll(bus, agents, completed)
        hearing.cancel()
        await asyncio.gather(hearing, return_exceptions=True)


async def _poll(bus: Bus, agents: Mapping[str, SimulatedAgent], completed: set[str]) -> None:
    tasks, started = _graph(), set[str]()
    while len(completed) < len(tasks):
        for task in tasks:
            if task.task not in started and completed.issuperset(task.instruction_function.dependencies):
                started.add(task.task)
                _start(bus, agents[task.instruction_function.robot_ids[0]], task)
        await asyncio.sleep(POLL_S)


def _start(bus: Bus, agent: SimulatedAgent, task: PlanTask) -> None:
    request = SkillRequest(
        action=RequestAction.START,
        mission_id=POLLED,
        task_id=task.task,
        attempt=1,
        epoch=1,
        robot_id=agent.robot_id,
        boot_id=agent.card.boot_id,
        skill="excavator_digging",
        issued_at=time.time(),
        deadline=time.time() + WAIT_S,
    )
    bus.publish(SKILL_REQUEST, request, robot_id=agent.robot_id, skill=request.skill)


if __name__ == "__main__":
    for row in measure():
        print(row)
