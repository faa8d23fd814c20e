"""kill -9 of scheduler and agents at each place of their writes and sends, in real processes over a real router.

The short form takes the places that matter most; the long one every place by number, and pairs: a second death on the
way back. The oracle is the file that the agents append to at each physical start and end.
"""

import asyncio
import contextlib
import json
import time
from collections import Counter
from collections.abc import AsyncGenerator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from muster_bus import Bus, NoReplyError, RefusedError
from muster_bus.testing import Process, RouterProcess, eventually, running_bus
from muster_scheduler.testing import as_seen, planned, yard_file
from muster_schemas.channels import MISSIONS, OBJECT, SUBMIT
from muster_schemas.mission import MissionStatus, MissionView
from muster_schemas.plan import Plan, PlanTask
from muster_schemas.rpc import ControlReply, MissionsQuery, MissionsReply, SubmitMission
from muster_schemas.site import load_site

pytestmark = pytest.mark.timeout(900)

SITE = load_site(yard_file())
E1, T1 = "robot_excavator_01", "robot_dump_truck_01"
HOME, AVOID, ALLOW = (f"{what}_for_specific_robots" for what in ("return_to_start", "avoid_areas", "allow_areas"))
WITHIN_S = 400.0
"""For one mission with one death; generous, for a machine with other work."""
MODULES = {"scheduler": "muster_scheduler", "agents": "muster_robot_agent"}
SHORT = [
    ("scheduler", "commit:4"),
    ("scheduler", "committed:4"),
    ("scheduler", "send:12"),
    ("agents", "committed:2"),
    ("agents", "begun:2"),
    ("agents", "end:2"),
]
PAIRS = [
    (first, second)
    for first in (("scheduler", "committed:4"), ("scheduler", "send:12"), ("agents", "begun:2"), ("agents", "end:2"))
    for second in (
        ("scheduler", "commit:1"),
        ("scheduler", "committed:1"),
        ("agents", "commit:1"),
        ("agents", "send:1"),
    )
]


def diamond() -> tuple[PlanTask, ...]:
    """Return six tasks: a team, two branches and a rule beside them, then a team again. All may be repeated."""
    return (
        planned("gather", HOME, [E1, T1]),
        planned("left", HOME, [E1], after=["gather"]),
        planned("right", HOME, [T1], after=["gather"]),
        planned("keep_out", AVOID, [T1], after=["gather"], objects=["puddle2"]),
        planned("meet", HOME, [E1, T1], after=["left", "right", "keep_out"]),
        planned("open_again", ALLOW, [T1], after=["meet"], objects=["puddle2"]),
    )


@dataclass
class Stage:
    """A scheduler and an agents' process, each started again when it dies, with the next place to die at."""

    router: RouterProcess
    folder: Path
    deaths: dict[str, list[str]]
    """Per process, where its next lives die."""
    died: Counter[str] = field(default_factory=Counter[str])
    processes: list[Process] = field(default_factory=list[Process])

    async def supervise(self, name: str) -> None:
        """Keep one process running."""
        try:
            while True:
                deaths = self.deaths.get(name, [])
                crash = {"MUSTER_CRASH_AT": deaths.pop(0)} if deaths else {}
                process = Process(MODULES[name], {**self._environment(), **crash})
                self.processes.append(process)
                await process.ended(within_s=1e6)
                self.died[name] += 1
        finally:
            for process in self.processes:
                process.dispose()

    def _environment(self) -> dict[str, str]:
        return {
            **self.router.environment,
            "MUSTER_DATA_DIR": str(self.folder),
            "MUSTER_HISTORY_FILE": str(self.folder / "history.jsonl"),
            "MUSTER_ROBOT_ID": f"{E1},{T1}",
            "MUSTER_DRIVER": "kinematic",
            "MUSTER_SPEED_FACTOR": "4",
        }

    def history(self) -> list[tuple[str, str, str, int]]:
        """Return (start or end, robot, task, attempt) in the order of happening."""
        lines = (self.folder / "history.jsonl").read_text().splitlines()
        found = [json.loads(line) for line in lines]
        return [(e["event"], e["robot_id"], e["task_id"], e["attempt"]) for e in found]


@contextlib.asynccontextmanager
async def stage(router: RouterProcess, folder: Path, deaths: dict[str, list[str]]) -> AsyncGenerator[tuple[Stage, Bus]]:
    """Run scheduler and agents while entered."""
    running = Stage(router, folder, deaths)
    async with running_bus(router) as bus:
        for thing in SITE.things:
            bus.publish(OBJECT, as_seen(thing, time.time()), object_name=thing.name)
        supervisors = [asyncio.create_task(running.supervise(name)) for name in MODULES]
        try:
            yield running, bus
        finally:
            for supervisor in supervisors:
                supervisor.cancel()
            await asyncio.gather(*supervisors, return_exceptions=True)


async def run_the_diamond(bus: Bus) -> MissionView:
    """Submit it until it is taken, and return it when it has ended."""
    request = SubmitMission(text="diamond", plan=Plan(tasks=diamond()), idempotency_key="diamond")

    async def taken() -> str | None:
        with contextlib.suppress(NoReplyError, RefusedError):
            reply: ControlReply = await bus.ask(SUBMIT, request, timeout_s=10)
            return reply.mission_id
        return None

    mission_id = await eventually(taken, WITHIN_S)

    async def ended() -> MissionView | None:
        with contextlib.suppress(NoReplyError, RefusedError):
            reply: MissionsReply = await bus.ask(MISSIONS, MissionsQuery(mission_id=mission_id), timeout_s=10)
            if reply.missions[0].mission.state.ended:
                return reply.missions[0]
        return None

    view = await eventually(ended, WITHIN_S)
    assert view is not None
    return view


def problems(view: MissionView, history: list[tuple[str, str, str, int]]) -> list[str]:
    """Return what was done twice, out of order, or not at all."""
    found: list[str] = []
    for (_, robot, task_id, attempt), count in Counter(h for h in history if h[0] == "start").items():
        if count > 1:
            found.append(f"{robot} started {task_id} attempt {attempt} {count} times")
    rules = {t.task_id for t in view.tasks if "areas" in t.skill}  # robots obey these by what they read
    for task in view.tasks:
        if task.task_id in rules:
            continue
        starts = [n for n, h in enumerate(history) if h[0] == "start" and h[2] == task.task_id]
        if len({history[n][1] for n in starts}) < len(task.robots):
            found.append(f"{task.task_id} was not started by all of {task.robots}")
        for before in set(task.dependencies) - rules:
            ends = [n for n, h in enumerate(history) if h[0] == "end" and h[2] == before]
            if not ends or not starts or min(starts) < max(ends):
                found.append(f"{task.task_id} started before {before} had ended")
    return found


async def die(router: RouterProcess, folder: Path, deaths: dict[str, list[str]]) -> tuple[Stage, MissionView]:
    """Let the diamond run with these deaths on the way."""
    async with stage(router, folder, deaths) as (running, bus):
        return running, await run_the_diamond(bus)


def said(view: MissionView) -> str:
    """Return how a mission and its tasks stand, in short."""
    tasks = [f"{t.task_id} {t.name} {t.state} attempt {t.attempt} {t.error or ''}" for t in view.tasks]
    return "\n".join([f"{view.mission.state} {view.mission.reasons}", *tasks])


def check(process: str, running: Stage, view: MissionView) -> None:
    """Check what must hold after a death: of the scheduler, nobody notices; of an agent, its task says what became."""
    if process == "scheduler":
        assert view.mission.state is MissionStatus.SUCCEEDED, said(view)
        assert problems(view, running.history()) == [], said(view)
        return
    starts = Counter(h for h in running.history() if h[0] == "start")
    assert [h for h, count in starts.items() if count > 1] == [], said(view)
    assert all(t.state.ended for t in view.tasks), said(view)
    assert view.mission.state is MissionStatus.SUCCEEDED or any(t.error for t in view.tasks), said(view)


@pytest.mark.parametrize(("process", "place"), SHORT)
async def test_a_mission_survives_a_death_at_any_place(
    process: str, place: str, router: RouterProcess, tmp_path: Path
) -> None:
    """Nothing is lost, nothing started twice, and the mission ends."""
    running, view = await die(router, tmp_path, {process: [place]})
    assert running.died[process] == 1
    check(process, running, view)


@pytest.mark.long
@pytest.mark.timeout(4 * 3600)
@pytest.mark.parametrize("process", MODULES)
async def test_a_mission_survives_a_death_at_every_numbered_place(
    process: str, router: RouterProcess, tmp_path: Path
) -> None:
    """From the first place that the process passes to the last before the mission has ended."""
    for number in range(1, 2000):
        running, view = await die(router, tmp_path / str(number), {process: [str(number)]})
        check(process, running, view)
        if running.died[process] == 0:
            assert number > 30, "the sweep ended before it had begun"
            return


@pytest.mark.long
@pytest.mark.parametrize(("first", "second"), PAIRS)
async def test_a_mission_ends_although_a_second_death_comes_on_the_way_back(
    first: tuple[str, str], second: tuple[str, str], router: RouterProcess, tmp_path: Path
) -> None:
    """Each task ends, none silently; what may be tried once more is not tried for ever."""
    deaths: dict[str, list[str]] = {first[0]: [first[1]]}
    deaths.setdefault(second[0], []).append(second[1])
    running, view = await die(router, tmp_path, deaths)
    check("agents", running, view)
