"""A whole site in real processes under `muster up`'s supervisor, for tests across services."""

import asyncio
import contextlib
import json
import os
import signal
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest
from muster_bus import Bus, NoReplyError
from muster_bus.testing import SITE_FILE, eventually, free_port
from muster_cli import launch, site
from muster_cli.processes import Options
from muster_cli.readiness import wait_until_ready
from muster_cli.record import DataDirectory, SiteRecord, Standing
from muster_schemas.channels import MISSIONS, SUBMIT
from muster_schemas.mission import MissionStatus, MissionView
from muster_schemas.plan import Plan
from muster_schemas.rpc import ControlReply, MissionsQuery, MissionsReply, SubmitMission
from muster_schemas.site import load_site
from rich.console import Console

PLANS = Path(__file__).parent / "plans"


def plan_of_case(name: str) -> Plan:
    """Return one of the committed plans."""
    return Plan.model_validate_json((PLANS / f"{name}.json").read_bytes())


@dataclass(frozen=True)
class Event:
    """One line of the agents' history: a skill's physical start or end."""

    event: str
    robot_id: str
    mission_id: str
    task_id: str
    attempt: int


class RunningSite:
    """The site of one test."""

    def __init__(self, directory: DataDirectory, history_file: Path) -> None:
        self._directory = directory
        self._history_file = history_file

    @property
    def record(self) -> SiteRecord:
        """What the supervisor says now."""
        record = self._directory.read()
        assert record is not None, "the site's supervisor is gone"
        return record

    @property
    def url(self) -> str:
        """The operator's interface."""
        return self.record.plan.url

    @property
    def endpoint(self) -> str:
        """The router."""
        return self.record.plan.endpoint

    def log(self, process: str) -> str:
        """Return what a process has written."""
        return self._directory.log_of(process).read_text(errors="replace")

    def history(self, mission_id: str) -> list[Event]:
        """Return the physical starts and ends of a mission, in the order in which they happened."""
        if not self._history_file.exists():
            return []
        lines: list[dict[str, Any]] = [json.loads(line) for line in self._history_file.read_text().splitlines()]
        return [
            Event(line["event"], line["robot_id"], line["mission_id"], line["task_id"], line["attempt"])
            for line in lines
            if line["mission_id"] == mission_id
        ]

    async def ready(self, within_s: float = 300.0) -> None:
        """Wait until every part is there and the map is whole, as after an earlier test's kill."""
        plan = self.record.plan
        await wait_until_ready(plan, load_site(SITE_FILE), self._directory, within_s, lambda _: None)

    def began(self, mission_id: str, robot_id: str) -> Event | None:
        """Return what a robot has begun and not ended, as far as its agent has told."""
        events = [e for e in self.history(mission_id) if e.robot_id == robot_id]
        return events[-1] if events and events[-1].event == "start" else None

    async def kill_at_work(self, robot_id: str, mission_id: str, within_s: float = 300.0) -> Event:
        """Kill a robot's agent in the middle of a skill and return which one; wait until it was started again.

        It is halted (SIGSTOP) before its history is read for the last time: what it has not ended by then, it never
        ends. However slowly this test runs, the kill comes in the middle.
        """
        until = time.monotonic() + within_s
        while time.monotonic() < until:
            if self.began(mission_id, robot_id):
                agent = await _halted(self._running(robot_id))
                if begun := self.began(mission_id, robot_id):
                    await asyncio.to_thread(self.kill, robot_id)
                    return begun
                agent.resume()
            await asyncio.sleep(0.01)
        pytest.fail(f"{robot_id} was not found at work within {within_s:.0f} s: {self.history(mission_id)}")

    def kill(self, process: str, within_s: float = 300.0) -> None:
        """End a process by kill -9 and wait until the supervisor has started it again."""
        before = self._running(process)
        os.kill(before, signal.SIGKILL)
        until = time.monotonic() + within_s
        while self._pid(process) in (None, before):
            assert time.monotonic() < until, f"{process} was not started again"
            time.sleep(0.05)

    def _pid(self, process: str) -> int | None:
        return next(p.pid for p in self.record.processes if p.name == process)

    def _running(self, process: str) -> int:
        pid = self._pid(process)
        assert pid is not None, f"{process} does not run"
        return pid

    def problems(self) -> list[str]:
        """Return the processes that do not run or had to be started again."""
        return [
            f"{p.name}: {p.standing}, {p.restarts} restarts, last exit {p.exit_code}\n{self.log(p.name)[-2000:]}"
            for p in self.record.processes
            if p.standing is not Standing.RUNNING or p.restarts
        ]


async def _halted(pid: int) -> psutil.Process:
    process = psutil.Process(pid)
    process.suspend()
    await eventually(lambda: process.status() == psutil.STATUS_STOPPED, within_s=60)
    return process


@contextlib.contextmanager
def running_site(root: Path, *, speed: float, planner: str = "embedded") -> Generator[RunningSite]:
    """Run the default site with data and history below `root`; nothing of it is left afterwards."""
    history = root / "history.jsonl"
    chosen = Options(
        site_file=SITE_FILE,
        data_dir=root / "data",
        bus_port=free_port(),
        port=free_port(),
        speed_factor=speed,
        driver="sim",
        planner=planner,
        log_level="info",
    )
    directory = DataDirectory(chosen.data_dir)
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("MUSTER_HISTORY_FILE", str(history))
        site.up(chosen, Console(stderr=True))
    try:
        yield RunningSite(directory, history)
    finally:
        launch.stop(directory)


async def submit(bus: Bus, text: str, plan: Plan | None = None) -> str:
    """Hand a mission to the scheduler and return its id."""
    reply: ControlReply = await bus.ask(SUBMIT, SubmitMission(text=text, plan=plan), timeout_s=60)
    return reply.mission_id


async def until_ended(bus: Bus, mission_id: str, within_s: float) -> MissionView:
    """Return the mission once it has ended; fail the test with all its tasks if it does not in time."""
    until = time.monotonic() + within_s
    while True:
        view = await look(bus, mission_id)
        if view is not None and view.mission.state.ended:
            return view
        if time.monotonic() > until:
            pytest.fail(f"not ended after {within_s:.0f} s: {describe(view)}")
        await asyncio.sleep(0.1)


async def look(bus: Bus, mission_id: str) -> MissionView | None:
    """Return a mission as the scheduler has it, or None if it does not answer now."""
    try:
        reply: MissionsReply = await bus.ask(MISSIONS, MissionsQuery(mission_id=mission_id), timeout_s=10)
    except NoReplyError:
        return None
    return reply.missions[0]


def describe(view: MissionView | None) -> str:
    """Return a mission and its tasks in some lines."""
    if view is None:
        return "the scheduler does not answer"
    mission = view.mission
    tasks = [
        f"  {t.task_id} {t.name} {t.skill} {','.join(t.objects)} {','.join(t.robots)} {t.state} "
        f"waits for {t.waiting_for} attempt {t.attempt} error {t.error}"
        for t in view.tasks
    ]
    return "\n".join([f"{mission.mission_id} {mission.text} {mission.state} {mission.reasons}", *tasks])


def succeeded(view: MissionView) -> bool:
    """Whether the mission reached its end as planned."""
    return view.mission.state is MissionStatus.SUCCEEDED


def order_problems(view: MissionView, history: list[Event]) -> list[str]:
    """Return what is wrong with the order of physical starts and ends, and with how often each came."""
    problems: list[str] = []
    for task in view.tasks:
        for robot in task.robots:
            events = [(e.attempt, e.event) for e in history if (e.task_id, e.robot_id) == (task.task_id, robot)]
            attempts = sorted({attempt for attempt, _ in events})
            if not events or events != [(a, event) for a in attempts for event in ("start", "end")]:
                problems.append(f"{task.name} ({robot}): {events} in place of one start and one end of each attempt")
        first = next((n for n, e in enumerate(history) if e.task_id == task.task_id and e.event == "start"), None)
        for before in task.dependencies:
            last = max((n for n, e in enumerate(history) if e.task_id == before and e.event == "end"), default=None)
            if first is None or last is None or first < last:
                problems.append(f"{task.name} started before {before} had ended")
    return problems
