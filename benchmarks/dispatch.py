"""How long the next robot waits for its request after the task before it was done.

Measured from the put of the status that makes a task ready to the arrival of the next skill request at a raw Zenoh
subscriber: router, scheduler and this process are real processes, nothing of the scheduler's is left out. Beside it, in
the same rhythm and turn about (one round trip, one commit, one handover), the floor that no scheduler can beat: a raw
round trip of the same size through the same router to an echo in another process, and one commit of SQLite that
reached the disk (`synchronous=FULL`) in the same folder. The pause before each of the three is what it is in the
field, where tasks take seconds: processes sleep, caches are cold.
"""

import asyncio
import contextlib
import queue
import sqlite3
import statistics
import tempfile
import time
from collections.abc import AsyncGenerator, Callable, Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from muster_bus import Bus
from muster_bus.round_trip import Arrivals, Wire, echoing
from muster_bus.testing import running_bus, running_router, service_process
from muster_scheduler.testing import planned, yard_file
from muster_scheduler.testing_agents import SimulatedAgent
from muster_schemas.channels import SKILL_REQUEST, SKILL_STATUS, SUBMIT
from muster_schemas.plan import Plan
from muster_schemas.robot import SkillRequest, SkillStatus, SkillStatusKind
from muster_schemas.rpc import SubmitMission
from muster_schemas.site import load_site

FLOOR_BAR: Final = 2.0
SITE: Final = load_site(yard_file())
ROBOTS: Final = ("robot_excavator_01", "robot_excavator_02")
CHAIN: Final = 100
"""Tasks of a mission, which two robots do in turn; the most that a plan may have."""
MISSIONS: Final = 2
PAUSE_S: Final = 0.02
MESSAGE_BYTES: Final = 500
"""About the size of a status, a request or an event."""
WAIT_S: Final = 60.0


@dataclass
class Times:
    """Seconds, one entry a handover."""

    from_put: list[float] = field(default_factory=list[float])
    """From the put of the status to the arrival of the request."""
    from_arrival: list[float] = field(default_factory=list[float])
    """From the arrival of the status at a raw subscriber to that of the request at the same."""
    round_trip: list[float] = field(default_factory=list[float])
    commit: list[float] = field(default_factory=list[float])


def measure() -> list[dict[str, Any]]:
    """Return the dispatch latency and its floor."""
    times = asyncio.run(_measure())
    trip, commit = statistics.median(times.round_trip), statistics.median(times.commit)
    waited = statistics.quantiles(times.from_put, n=100, method="inclusive")
    return [
        _row("dispatch_p50_over_floor", waited[49] / (trip + commit), "x", FLOOR_BAR),
        _row("dispatch_p50_ms", 1000 * waited[49], "ms"),
        _row("dispatch_p99_ms", 1000 * waited[98], "ms"),
        _row("dispatch_from_arrival_p50_ms", 1000 * statistics.median(times.from_arrival), "ms"),
        _row("dispatch_floor_ms", 1000 * (trip + commit), "ms"),
        _row("dispatch_floor_round_trip_ms", 1000 * trip, "ms"),
        _row("dispatch_floor_commit_ms", 1000 * commit, "ms"),
    ]


def _row(name: str, value: float, unit: str, bar: float | None = None) -> dict[str, Any]:
    return {"name": name, "value": round(value, 3), "unit": unit, "bar": bar, "ok": bar is None or value <= bar}


async def _measure() -> Times:
    times = Times()
    with contextlib.ExitStack() as stack:
        router = stack.enter_context(running_router())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        speaking, hearing = (stack.enter_context(Wire(router.endpoint)) for _ in range(2))
        requests = hearing.hear(SKILL_REQUEST.key(site=SITE.name))
        statuses = hearing.hear(SKILL_STATUS.key(site=SITE.name))
        trip = stack.enter_context(echoing(router.endpoint))
        commit = stack.enter_context(_committing(folder / "floor.sqlite"))
        async with (
            running_bus(router) as bus,
            _standing(bus, ROBOTS),
            service_process("muster_scheduler", router, {"MUSTER_DATA_DIR": str(folder)}) as scheduler,
        ):
            await scheduler.until_logged("serving")
            for _ in range(MISSIONS):
                names = [f"n{i}" for i in range(CHAIN)]
                tasks = [
                    planned(n, "Excavation", [ROBOTS[i % 2]], names[max(i - 1, 0) : i]) for i, n in enumerate(names)
                ]
                await bus.ask(SUBMIT, SubmitMission(text="measure", plan=Plan(tasks=tuple(tasks))), timeout_s=WAIT_S)
                player = _Player(speaking, requests, statuses, times)
                await asyncio.to_thread(player.play, trip, commit)
    return times


class _Player:
    """Plays both robots of one chain: says that a task is done, and waits for the request of the next."""

    def __init__(self, wire: Wire, requests: Arrivals, statuses: Arrivals, times: Times) -> None:
        self._wire = wire
        self._requests = requests
        self._statuses = statuses
        self._times = times
        self._seen: set[str] = set()

    def play(self, trip: Callable[[int], float], commit: Callable[[], float]) -> None:
        """Do the whole chain, and before each handover one of each part of the floor."""
        _, request = self._next_request()
        for _ in range(CHAIN - 1):
            self._say(request, SkillStatusKind.STARTED, 1)
            time.sleep(PAUSE_S)
            self._times.round_trip.append(trip(MESSAGE_BYTES))
            time.sleep(PAUSE_S)
            self._times.commit.append(commit())
            time.sleep(PAUSE_S)
            _empty(self._statuses)
            said_at = self._say(request, SkillStatusKind.SUCCEEDED, 2)
            came_at, request = self._next_request()
            self._times.from_put.append(came_at - said_at)
            self._times.from_arrival.append(came_at - self._statuses.get(timeout=WAIT_S)[0])
        self._say(request, SkillStatusKind.STARTED, 1)
        self._say(request, SkillStatusKind.SUCCEEDED, 2)

    def _next_request(self) -> tuple[float, SkillRequest]:
        """Return when the next request came that is no repetition, and what it was."""
        while True:
            came_at, body = self._requests.get(timeout=WAIT_S)
            request = SkillRequest.model_validate_json(body)
            if request.task_id not in self._seen:
                self._seen.add(request.task_id)
                return came_at, request

    def _say(self, request: SkillRequest, kind: SkillStatusKind, seq: int) -> float:
        status = SkillStatus(
            mission_id=request.mission_id,
            task_id=request.task_id,
            attempt=request.attempt,
            epoch=request.epoch,
            robot_id=request.robot_id,
            boot_id=request.boot_id,
            skill=request.skill,
            seq=seq,
            state=kind,
            at=time.time(),
        )
        key = SKILL_STATUS.key(site=SITE.name, robot_id=request.robot_id, skill=request.skill)
        return self._wire.put(key, status.to_json())


class _Standing(SimulatedAgent):
    """Is there, and leaves the answering to the player."""

    def _obey(self, request: SkillRequest) -> None:
        pass


@contextlib.asynccontextmanager
async def _standing(bus: Bus, robots: Sequence[str]) -> AsyncGenerator[None]:
    async with contextlib.AsyncExitStack() as stack:
        for robot_id in robots:
            await stack.enter_async_context(_Standing(bus, SITE, robot_id).life())
        yield


@contextlib.contextmanager
def _committing(path: Path) -> Generator[Callable[[], float]]:
    """Yield what commits one message, in the way of the scheduler's journal, and returns its seconds."""
    with contextlib.closing(sqlite3.connect(path, isolation_level=None, check_same_thread=False)) as db:
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA synchronous=FULL")
        db.execute("CREATE TABLE events (seq INTEGER PRIMARY KEY, body BLOB NOT NULL)")

        def commit() -> float:
            begun = time.perf_counter()
            db.execute("INSERT INTO events (body) VALUES (?)", (b"x" * MESSAGE_BYTES,))
            return time.perf_counter() - begun

        yield commit


def _empty(arrivals: Arrivals) -> None:
    with contextlib.suppress(queue.Empty):
        while True:
            arrivals.get_nowait()


if __name__ == "__main__":
    for row in measure():
        print(row)
