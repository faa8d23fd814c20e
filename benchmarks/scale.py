"""A thousand robots: hosted by a few processes, seen by one scheduler, and given missions that run to their end.

Robots are kinematic trucks of a generated site, each with its own journal, liveliness token, card and state at the
full rate, over the real bus. Their tasks need no driving (what a drive costs depends on the site, not on the
scheduler): each is a request, an attempt journaled and fsynced by the agent, its machine felt, and the statuses and
acknowledgements between. If a thousand do not all come up in time, half as many are tried; the rows say how many.
"""

import asyncio
import contextlib
import json
import math
import os
import tempfile
import time
from collections.abc import AsyncGenerator, Sequence
from pathlib import Path
from typing import Any, Final

from muster_bus import Bus, open_bus
from muster_bus.testing import Process, RouterProcess, running_router
from muster_scheduler.testing import planned
from muster_schemas.channels import MISSION_STATE, ROBOT_ALIVE, ROBOT_STATE, SUBMIT
from muster_schemas.mission import MissionStatus
from muster_schemas.plan import Plan
from muster_schemas.rpc import ControlReply, SubmitMission

TRIED: Final = (1000, 500, 250, 100)
HOSTS: Final = 2
"""Each of them hears the states of all robots, so more hosts than cores only cost more."""
COME_UP_S: Final = 180.0
RUN_S: Final = 300.0
SPACING_M: Final = 10.0
TEAM: Final = 33
"""Robots of a mission; each does `ROUNDS` tasks, so that a plan has at most 100."""
ROUNDS: Final = 3
LOOK_S: Final = 10.0
"""How long the idle fleet is looked at."""
CLOCK_TICKS: Final = os.sysconf("SC_CLK_TCK")
PAGE_KB: Final = os.sysconf("SC_PAGE_SIZE") / 1024


def measure() -> list[dict[str, Any]]:
    """Return how many robots worked, what they took, and how long their missions were."""
    for count in TRIED:
        rows = asyncio.run(_measure(count))
        if rows:
            return rows
    raise RuntimeError(f"not even {TRIED[-1]} robots came up within {COME_UP_S:.0f} s")


def _row(name: str, value: float, unit: str, bar: float | None = None, *, ok: bool = True) -> dict[str, Any]:
    return {"name": name, "value": round(value, 3), "unit": unit, "bar": bar, "ok": ok}


async def _measure(count: int) -> list[dict[str, Any]]:
    """Return the rows for so many robots; none if they do not come up in time."""
    with running_router() as router, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        robots = [f"robot_truck_{n:04}" for n in range(count)]
        (folder / "site.yaml").write_text(json.dumps(_site(robots)), encoding="utf-8")
        begun = time.monotonic()
        async with open_bus("many", (router.endpoint,)) as bus, _processes(router, folder, robots) as processes:
            if not await _until_alive(bus, robots):
                return []
            await processes[0].until_logged("serving", COME_UP_S)
            up_s = time.monotonic() - begun
            idle = await _cpu_shares(processes, LOOK_S)
            states_hz = await _states_per_s(bus, LOOK_S)
            begun, before = time.monotonic(), _cpu_s(processes)
            missions, tasks = await _run_missions(bus, robots)
            ran_s = time.monotonic() - begun
            worked = [after - was for was, after in zip(before, _cpu_s(processes), strict=True)]
            hosts_kb = sum(_rss_kb(p) for p in processes[1:])
            all_ran = missions == math.ceil(count / TEAM)
            return [
                _row("robots_hosted", count, "robots", TRIED[0], ok=count == TRIED[0] and all_ran),
                _row("robots_all_up_s", up_s, "s"),
                _row("robot_states_per_s", states_hz, "1/s"),
                _row("robot_memory_kb", hosts_kb / count, "kB"),
                _row("hosts_idle_cpu", sum(idle[1:]), "cores"),
                _row("scheduler_idle_cpu_of_many_robots", idle[0], "cores"),
                _row("scheduler_cpu_ms_per_task", 1000 * worked[0] / tasks, "ms"),
                _row("hosts_cpu_ms_per_task", 1000 * sum(worked[1:]) / tasks, "ms"),
                _row("missions_of_many_robots_s", ran_s, "s"),
                _row("tasks_per_s_of_many_robots", tasks / ran_s, "1/s"),
            ]


def _site(robots: Sequence[str]) -> dict[str, Any]:
    """Return the file of a site with robots on a square grid."""
    side = math.ceil(math.sqrt(len(robots)))
    half = SPACING_M * (side + 1) / 2
    truck = {
        "body": "dump_truck",
        "letter": "T",
        "length_m": 3.6,
        "width_m": 2.2,
        "max_speed_mps": 2.5,
        "max_turn_radps": 0.8,
        "capacity_m3": 1.5,
    }
    homes = [
        {"x": SPACING_M * (n % side + 1) - half, "y": SPACING_M * (n // side + 1) - half, "yaw": 0}
        for n in range(len(robots))
    ]
    return {
        "name": "many",
        "bounds": {"min_x": -half, "min_y": -half, "max_x": half, "max_y": half},
        "robot_types": {"dump_truck": truck},
        "robots": [{"id": r, "type": "dump_truck", "home": h} for r, h in zip(robots, homes, strict=True)],
    }


@contextlib.asynccontextmanager
async def _processes(router: RouterProcess, folder: Path, robots: Sequence[str]) -> AsyncGenerator[list[Process]]:
    """Run the scheduler (first) and the hosts."""
    env = {**router.environment, "MUSTER_SITE_FILE": str(folder / "site.yaml")}
    each = math.ceil(len(robots) / HOSTS)
    shares = [robots[i : i + each] for i in range(0, len(robots), each)]
    processes = [Process("muster_scheduler", {**env, "MUSTER_DATA_DIR": str(folder / "scheduler")})]
    for share in shares:
        data = {"MUSTER_DATA_DIR": str(folder / "agents"), "MUSTER_LOG_LEVEL": "warning"}
        chosen = f"{share[0]}..{share[-1]}"
        processes.append(Process("muster_robot_agent.host", {**env, **data}, "--robots", chosen))
    try:
        yield processes
    finally:
        for process in processes:
            await asyncio.to_thread(process.dispose)


async def _until_alive(bus: Bus, robots: Sequence[str]) -> bool:
    """Wait until every robot's token is there and its state has come; return whether they all came in time."""
    silent = set(robots)
    try:
        async with asyncio.timeout(COME_UP_S), bus.subscribe(ROBOT_STATE) as states:
            async for received in states:
                silent.discard(received.ids["robot_id"])
                if not silent and len(await bus.who_is_alive(ROBOT_ALIVE)) >= len(robots):
                    return True
    except TimeoutError:
        pass
    return False


async def _states_per_s(bus: Bus, seconds: float) -> float:
    """Return how many states come in a second; a stream keeps only the newest of a robot that is not read in time."""
    heard = 0
    with contextlib.suppress(TimeoutError):
        async with bus.subscribe(ROBOT_STATE) as states, asyncio.timeout(seconds):
            async for _ in states:
                heard += 1
    return heard / seconds


async def _run_missions(bus: Bus, robots: Sequence[str]) -> tuple[int, int]:
    """Run missions that use every robot; return how many succeeded, and their tasks."""
    tasks = 0
    wanted: set[str] = set()
    succeeded: set[str] = set()
    async with bus.subscribe(MISSION_STATE) as states:
        for start in range(0, len(robots), TEAM):
            plan = _mission(robots[start : start + TEAM])
            tasks += len(plan.tasks)
            reply: ControlReply = await bus.ask(SUBMIT, SubmitMission(text="measure", plan=plan), timeout_s=60.0)
            wanted.add(reply.mission_id)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(RUN_S):
                async for received in states:
                    mission = received.message
                    if mission is not None and mission.state is MissionStatus.SUCCEEDED:
                        succeeded.add(mission.mission_id)
                    elif mission is not None and mission.state.ended:
                        raise RuntimeError(f"mission {mission.mission_id} ended {mission.state}: {mission.reasons}")
                    if succeeded >= wanted:
                        break
    return len(succeeded), tasks


def _mission(robots: Sequence[str]) -> Plan:
    """Return rounds of one task for each robot; each waits for its own last one and for its neighbour's."""
    tasks = [
        planned(
            f"n{turn}-{place}",
            "DumpUnloading",
            [robot_id],
            [f"n{turn - 1}-{p}" for p in {place, (place + 1) % len(robots)}] if turn else [],
        )
        for turn in range(ROUNDS)
        for place, robot_id in enumerate(robots)
    ]
    return Plan(tasks=tuple(tasks))


async def _cpu_shares(processes: Sequence[Process], seconds: float) -> list[float]:
    """Return how much of a core each process takes."""
    before, begun = _cpu_s(processes), time.monotonic()
    await asyncio.sleep(seconds)
    passed = time.monotonic() - begun
    return [(after - was) / passed for was, after in zip(before, _cpu_s(processes), strict=True)]


def _cpu_s(processes: Sequence[Process]) -> list[float]:
    """Return the processor seconds that each process has used."""
    stats = [Path(f"/proc/{p.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split() for p in processes]
    return [(int(s[11]) + int(s[12])) / CLOCK_TICKS for s in stats]


def _rss_kb(process: Process) -> float:
    return int(Path(f"/proc/{process.pid}/statm").read_text(encoding="ascii").split()[1]) * PAGE_KB


if __name__ == "__main__":
    for row in measure():
        print(row)
