"""What the scheduler's work costs: per event with few and with very many open tasks, and between two robots.

Costs per event are processor time of this process. The dispatch time is compared with the floor that no scheduler can
beat: one raw round trip through the router and one commit that reached the disk, both measured in the same run.
"""

import asyncio
import contextlib
import gc
import sqlite3
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from muster_bus.round_trip import round_trips
from muster_bus.testing import RouterProcess, running_bus, running_router, service_process
from muster_scheduler.testing import Yard, planned, yard_file
from muster_scheduler.testing_agents import SimulatedAgent, crew
from muster_schemas.channels import MISSIONS, SUBMIT
from muster_schemas.mission import MissionStatus
from muster_schemas.plan import Plan
from muster_schemas.robot import SkillStatusKind
from muster_schemas.rpc import ControlReply, MissionsQuery, MissionsReply, SubmitMission
from muster_schemas.site import load_site

FEW, MANY = 100, 100_000
MISSION_TASKS: Final = 100
PROBE_TASKS: Final = 500
RATIO_BAR: Final = 1.5
FLOOR_BAR: Final = 2.0
SITE: Final = load_site(yard_file())
ROBOTS: Final = ("robot_excavator_01", "robot_excavator_02", "robot_excavator_03")
MESSAGE_BYTES: Final = 500
"""About the size of a status or request."""
HANDOVERS: Final = 100
"""Tasks in a chain that two robots do in turn."""


def measure() -> list[dict[str, Any]]:
    """Return the cost of an event with many open tasks over that with few, events a second, and dispatch over floor."""
    few, many = _event_cost_s(FEW), _event_cost_s(MANY)
    dispatch_s, floor_s = asyncio.run(_dispatch())
    return [
        _row("event_cost_ratio_100k", many / few, "x", RATIO_BAR),
        _row("events_per_s", 1 / many, "1/s", None),
        _row("dispatch_p50_over_floor", dispatch_s / floor_s, "x", FLOOR_BAR),
        _row("dispatch_p50_ms", dispatch_s * 1000, "ms", None),
        _row("dispatch_floor_ms", floor_s * 1000, "ms", None),
    ]


def _row(name: str, value: float, unit: str, bar: float | None) -> dict[str, Any]:
    return {"name": name, "value": round(value, 3), "unit": unit, "bar": bar, "ok": bar is None or value <= bar}


def _event_cost_s(open_tasks: int) -> float:
    """Return the mean processor time of an event of one urgent mission while so many tasks of others wait."""
    yard = Yard(SITE, check=False)
    yard.open()
    for number in range(open_tasks // MISSION_TASKS):
        robot = ROBOTS[number % len(ROBOTS)]
        chain = [
            planned(f"n{i}", "Excavation", [robot], [f"n{i - 50}"] if i >= 50 else []) for i in range(MISSION_TASKS)
        ]
        yard.submit(*chain)
    yard.robot_comes("robot_excavator_01")  # its first task was never seen by this life, so it is given back
    names = [f"p{i}" for i in range(PROBE_TASKS)]
    probe = yard.submit(
        *(planned(n, "Excavation", [ROBOTS[0]], names[max(i - 1, 0) : i]) for i, n in enumerate(names)), priority=9
    )
    holder = yard.core.state.robots[ROBOTS[0]].holder
    if holder is None:
        raise RuntimeError("the robot of the measurement is idle")
    first = yard.core.state.missions[holder[0]].tasks[holder[1]]
    yard.say(ROBOTS[0], first, SkillStatusKind.SUCCEEDED)
    events_before = len(yard.events)
    gc.collect()  # what setting up left behind is no cost of the events
    begun = time.process_time()
    for task in probe.tasks.values():
        yard.say(ROBOTS[0], task, SkillStatusKind.STARTED)
        yard.say(ROBOTS[0], task, SkillStatusKind.SUCCEEDED)
    cost = time.process_time() - begun
    if not yard.ended_well(probe):
        raise RuntimeError("the mission that was measured did not succeed")
    return cost / (len(yard.events) - events_before)


async def _dispatch() -> tuple[float, float]:
    """Return (p50 from a robot's last word to the next robot's request, p50 of the floor), in seconds."""
    with running_router() as router, tempfile.TemporaryDirectory() as directory:
        floors = [await asyncio.to_thread(_floor_s, router, Path(directory))]
        handovers = await _handovers(router, Path(directory))
        floors.append(await asyncio.to_thread(_floor_s, router, Path(directory)))
        return statistics.median(handovers), statistics.mean(floors)


def _floor_s(router: RouterProcess, directory: Path) -> float:
    trips = round_trips(router.endpoint, 300, MESSAGE_BYTES)
    return statistics.median(trips) + statistics.median(_commits(directory / "floor.sqlite", 300))


def _commits(path: Path, count: int) -> list[float]:
    """Return the seconds of commits of one message each, in the way of the scheduler's journal."""
    seconds: list[float] = []
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA synchronous=FULL")
        db.execute("CREATE TABLE IF NOT EXISTS events (seq INTEGER PRIMARY KEY, body BLOB NOT NULL)")
        for _ in range(count):
            begun = time.perf_counter()
            db.execute("INSERT INTO events (body) VALUES (?)", (b"x" * MESSAGE_BYTES,))
            seconds.append(time.perf_counter() - begun)
    return seconds


async def _handovers(router: RouterProcess, directory: Path) -> list[float]:
    """Run a chain that two robots do in turn; return the seconds from each end to the next start."""
    names = [f"n{i}" for i in range(HANDOVERS)]
    chain = [planned(n, "Excavation", [ROBOTS[i % 2]], names[max(i - 1, 0) : i]) for i, n in enumerate(names)]
    env = {"MUSTER_DATA_DIR": str(directory)}
    async with (
        running_bus(router) as bus,
        crew(bus, SITE, ROBOTS[:2]) as agents,
        service_process("muster_scheduler", router, env) as scheduler,
    ):
        await scheduler.until_logged("serving")
        request = SubmitMission(text="measure", plan=Plan(tasks=tuple(chain)))
        reply: ControlReply = await bus.ask(SUBMIT, request, timeout_s=30)
        state = MissionStatus.RUNNING
        while not state.ended:
            await asyncio.sleep(0.5)
            query = MissionsQuery(states=(MissionStatus.RUNNING,))
            open_now: MissionsReply = await bus.ask(MISSIONS, query, timeout_s=30)
            state = MissionStatus.RUNNING if open_now.missions else MissionStatus.SUCCEEDED
        return _gaps(reply.mission_id, agents)


def _gaps(mission_id: str, agents: dict[str, SimulatedAgent]) -> list[float]:
    times = {
        (what, int(request.task_id.removeprefix("t"))): at
        for agent in agents.values()
        for at, what, request in agent.log
        if request.mission_id == mission_id
    }
    return [times["start", n + 1] - times["end", n] for n in range(1, HANDOVERS)]


if __name__ == "__main__":
    for row in measure():
        print(row)
