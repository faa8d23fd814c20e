"""The agent as a process on a real bus; the test speaks as the scheduler."""

import asyncio
import contextlib
import json
import signal
import time
from collections.abc import AsyncGenerator, AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from muster_bus import Bus, Received
from muster_bus.runtime import ALREADY_RUNNING_EXIT
from muster_bus.settings import BAD_SETTINGS_EXIT
from muster_bus.testing import Process, RouterProcess, eventually, running_bus, service_process
from muster_schemas.channels import (
    ROBOT_CARD,
    ROBOT_STATE,
    ROBOT_STOP,
    ROBOT_STOP_STATUS,
    SERVICE_ALIVE,
    SKILL_REQUEST,
    SKILL_STATUS,
    STATUS_ACK,
)
from muster_schemas.robot import (
    RequestAction,
    RobotCard,
    RobotState,
    SkillRequest,
    SkillStatus,
    SkillStatusKind,
    StatusAck,
)
from muster_schemas.stops import StopRequest, StopStatus

MODULE = "muster_robot_agent"
T1, T2 = "robot_dump_truck_01", "robot_dump_truck_02"
GO = "target_area_for_specific_robots"


@dataclass
class Listener:
    """Hears everything that agents say, and asks as a scheduler would."""

    bus: Bus
    cards: dict[str, RobotCard] = field(default_factory=dict[str, RobotCard])
    states: dict[str, RobotState] = field(default_factory=dict[str, RobotState])
    statuses: list[SkillStatus] = field(default_factory=list[SkillStatus])
    stops: list[StopStatus] = field(default_factory=list[StopStatus])

    async def follow_cards(self, messages: AsyncIterator[Received[RobotCard]]) -> None:
        """Keep the newest cards."""
        async for received in messages:
            if received.message is not None:
                self.cards[received.message.robot_id] = received.message

    async def follow_states(self, messages: AsyncIterator[Received[RobotState]]) -> None:
        """Keep the newest states."""
        async for received in messages:
            if received.message is not None:
                self.states[received.message.robot_id] = received.message

    async def follow_statuses(self, messages: AsyncIterator[Received[SkillStatus]]) -> None:
        """Keep every status."""
        async for received in messages:
            if received.message is not None:
                self.statuses.append(received.message)

    async def follow_stops(self, messages: AsyncIterator[Received[StopStatus]]) -> None:
        """Keep what is said of stops."""
        async for received in messages:
            if received.message is not None:
                self.stops.append(received.message)

    async def stop(self, number: int, *, stopped: bool, robot_id: str = T1) -> StopStatus:
        """Stop or release a robot as a scheduler would, until it has obeyed; return its word."""
        heard = len(self.stops)

        def obeyed() -> StopStatus | None:
            return next((s for s in self.stops[heard:] if s.number == number and (s.standing or not stopped)), None)

        for _ in range(240):
            request = StopRequest(robot_id=robot_id, number=number, stopped=stopped, issued_at=time.time())
            self.bus.publish(ROBOT_STOP, request, robot_id=robot_id)
            with contextlib.suppress(pytest.fail.Exception):
                status = await eventually(obeyed, 0.5)
                assert status is not None
                return status
        raise AssertionError("the robot did not obey")

    async def card(self, robot_id: str = T1, *, after: str = "") -> RobotCard:
        """Wait for a robot's card, of a later life than `after`."""

        def found() -> RobotCard | None:
            card = self.cards.get(robot_id)
            return card if card and card.boot_id > after else None

        card = await eventually(found, 240)
        assert card is not None
        return card

    def ask(self, card: RobotCard, action: object = RequestAction.START, **rest: object) -> SkillRequest:
        """Send a request; `rest` overrides any field."""
        fields: dict[str, object] = {
            "action": action,
            "mission_id": "m-1",
            "task_id": "t1",
            "attempt": 1,
            "epoch": 1,
            "robot_id": card.robot_id,
            "boot_id": card.boot_id,
            "skill": GO,
            "issued_at": time.time(),
            "deadline": time.time() + 3600,
            "goals": [{"x": 20, "y": -18, "yaw": 0}],
            **rest,
        }
        request = SkillRequest.model_validate(fields)
        self.bus.publish(SKILL_REQUEST, request, robot_id=card.robot_id, skill=request.skill)
        return request

    def acknowledge(self, status: SkillStatus) -> None:
        """Say that a status is in the journal."""
        ack = StatusAck.model_validate(status.model_dump(exclude={"skill", "state", "progress", "reason", "at"}))
        self.bus.publish(STATUS_ACK, ack, robot_id=status.robot_id, skill=status.skill)

    def states_of(self, task_id: str) -> list[SkillStatusKind]:
        """Return what was said about a task so far."""
        return [s.state for s in self.statuses if s.task_id == task_id]

    async def until_driving(self, robot_id: str = T1) -> None:
        """Wait until a robot drives."""
        await eventually(lambda: robot_id in self.states and self.states[robot_id].speed_mps > 0.3, 240)

    async def until(self, task_id: str, state: SkillStatusKind) -> SkillStatus:
        """Wait for a status."""
        await eventually(lambda: state in self.states_of(task_id), 240)
        return next(s for s in self.statuses if s.task_id == task_id and s.state is state)


@contextlib.asynccontextmanager
async def listening(router: RouterProcess) -> AsyncGenerator[Listener]:
    """Run a listener on a bus of its own."""
    async with (
        running_bus(router) as bus,
        bus.subscribe(ROBOT_CARD) as cards,
        bus.subscribe(ROBOT_STATE) as states,
        bus.subscribe(SKILL_STATUS) as statuses,
        bus.subscribe(ROBOT_STOP_STATUS) as stops,
    ):
        listener = Listener(bus)
        follows = (
            listener.follow_cards(cards),
            listener.follow_states(states),
            listener.follow_statuses(statuses),
            listener.follow_stops(stops),
        )
        tasks = [asyncio.create_task(follow) for follow in follows]
        yield listener
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def environment(folder: Path, robots: str = T1, factor: str = "10") -> dict[str, str]:
    """Return the settings of an agent with kinematic machines; a small factor where a drive must last long enough."""
    return {
        "MUSTER_ROBOT_ID": robots,
        "MUSTER_DRIVER": "kinematic",
        "MUSTER_SPEED_FACTOR": factor,
        "MUSTER_DATA_DIR": str(folder),
        "MUSTER_HISTORY_FILE": str(folder / "history.jsonl"),
    }


def history(folder: Path, event: str) -> list[dict[str, Any]]:
    """Return the physical starts or ends so far."""
    file = folder / "history.jsonl"
    lines = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    return [line for line in lines if line["event"] == event]


def journals(folder: Path) -> set[str]:
    """Return the names of the journals in a folder."""
    return {file.name for file in folder.glob("*.sqlite3")}


async def test_a_request_is_accepted_started_and_done_and_the_end_is_repeated(
    router: RouterProcess, tmp_path: Path
) -> None:
    """In this order, and the final word comes again and again until it is acknowledged."""
    async with listening(router) as scheduler, service_process(MODULE, router, environment(tmp_path)) as agent:
        card = await scheduler.card()
        for _ in range(3):
            scheduler.ask(card)
        final = await scheduler.until("t1", SkillStatusKind.SUCCEEDED)
        told = scheduler.states_of("t1")
        assert told[:2] == [SkillStatusKind.ACCEPTED, SkillStatusKind.STARTED]
        await eventually(lambda: scheduler.states_of("t1").count(SkillStatusKind.SUCCEEDED) >= 3)
        scheduler.acknowledge(final)
        assert len(history(tmp_path, "start")) == 1
        assert len(history(tmp_path, "end")) == 1
        # two repeats would have come in the time that another task takes
        scheduler.ask(card, task_id="t2", goals=[{"x": 0, "y": -18, "yaw": 0}])
        repeats = scheduler.states_of("t1").count(SkillStatusKind.SUCCEEDED)
        await scheduler.until("t2", SkillStatusKind.SUCCEEDED)
        await eventually(lambda: scheduler.states_of("t2").count(SkillStatusKind.SUCCEEDED) >= 3)
        assert scheduler.states_of("t1").count(SkillStatusKind.SUCCEEDED) <= repeats + 1
        pose = scheduler.states[T1].pose
        assert (pose.x, pose.y) == pytest.approx((0, -18), abs=0.4)
        assert await agent.terminate() == 0


async def test_killed_in_mid_drive_it_comes_back_and_says_interrupted(router: RouterProcess, tmp_path: Path) -> None:
    """The attempt is not begun again, its end is told, and the robot takes new work."""
    async with listening(router) as scheduler:
        async with service_process(MODULE, router, environment(tmp_path, factor="0.3")) as agent:
            first = await scheduler.card()
            scheduler.ask(first)
            await scheduler.until_driving()
            await agent.kill()
        async with service_process(MODULE, router, environment(tmp_path)):
            await scheduler.until("t1", SkillStatusKind.INTERRUPTED)
            second = await scheduler.card(after=first.boot_id)
            scheduler.ask(first)
            scheduler.ask(second, task_id="t2")
            await scheduler.until("t2", SkillStatusKind.SUCCEEDED)
    assert [line["task_id"] for line in history(tmp_path, "start")] == ["t1", "t2"]
    assert SkillStatusKind.SUCCEEDED not in scheduler.states_of("t1")


async def test_cancel_pause_and_resume_are_obeyed_by_the_machine(router: RouterProcess, tmp_path: Path) -> None:
    """`paused` and `cancelled` are said when the machine stands."""
    settings = environment(tmp_path, factor="0.7")
    async with listening(router) as scheduler, service_process(MODULE, router, settings):
        card = await scheduler.card()
        scheduler.ask(card)
        await scheduler.until_driving()
        scheduler.ask(card, RequestAction.PAUSE)
        await scheduler.until("t1", SkillStatusKind.PAUSED)
        await eventually(lambda: scheduler.states[T1].speed_mps == pytest.approx(0, abs=0.06))
        at = scheduler.states[T1].pose
        scheduler.ask(card, RequestAction.RESUME)
        await eventually(lambda: scheduler.states[T1].pose.distance(at) > 2, 240)
        scheduler.ask(card, RequestAction.CANCEL)
        await scheduler.until("t1", SkillStatusKind.CANCELLED)
        await eventually(lambda: scheduler.states[T1].busy_with is None and not scheduler.states[T1].path)
        assert SkillStatusKind.SUCCEEDED not in scheduler.states_of("t1")


async def test_a_stop_holds_the_machine_over_a_restart_until_the_release(router: RouterProcess, tmp_path: Path) -> None:
    """In mid-drive it comes to a stand and says so; idle it says that, too; it starts nothing before the release."""
    async with listening(router) as scheduler:
        async with service_process(MODULE, router, environment(tmp_path, factor="0.7")) as agent:
            card = await scheduler.card()
            scheduler.ask(card, goals=[{"x": 20 * (-1) ** n, "y": -18, "yaw": 0} for n in range(8)])
            await scheduler.until_driving()
            status = await scheduler.stop(7, stopped=True)
            assert (status.stopped, status.was_busy, status.busy_with is not None) == (True, True, True)
            await eventually(lambda: scheduler.states[T1].stopped and abs(scheduler.states[T1].speed_mps) < 0.06)
            at = scheduler.states[T1].pose
            await scheduler.stop(8, stopped=False)
            await eventually(lambda: scheduler.states[T1].pose.distance(at) > 2, 240)
            await scheduler.stop(9, stopped=True)
            await agent.kill()
        async with service_process(MODULE, router, environment(tmp_path)):
            second = await scheduler.card(after=card.boot_id)
            scheduler.ask(second, task_id="t2")
            refusal = await scheduler.until("t2", SkillStatusKind.REFUSED)
            assert "stopped" in (refusal.reason or "")
            assert not (await scheduler.stop(9, stopped=True)).was_busy
            await scheduler.stop(10, stopped=False)
            scheduler.ask(second, task_id="t3")
            await scheduler.until("t3", SkillStatusKind.STARTED)
    assert [line["task_id"] for line in history(tmp_path, "start")] == ["t1", "t3"]


async def test_a_cancel_that_overtakes_the_start_wins(router: RouterProcess, tmp_path: Path) -> None:
    """What is unknown stays undone."""
    async with listening(router) as scheduler, service_process(MODULE, router, environment(tmp_path)):
        card = await scheduler.card()
        scheduler.ask(card, RequestAction.CANCEL)
        await scheduler.until("t1", SkillStatusKind.UNKNOWN)
        scheduler.ask(card)
        scheduler.ask(card, task_id="t2")
        await scheduler.until("t2", SkillStatusKind.STARTED)
        assert [line["task_id"] for line in history(tmp_path, "start")] == ["t2"]


async def test_malformed_and_misdirected_requests_change_nothing(router: RouterProcess, tmp_path: Path) -> None:
    """Garbage on the key, another life's request, a passed deadline: nothing moves, and the next request is done."""
    async with listening(router) as scheduler, service_process(MODULE, router, environment(tmp_path)):
        card = await scheduler.card()
        key = SKILL_REQUEST.key(site="yard", robot_id=T1, skill=GO)
        for garbage in (b"", b"{", b'{"action":"start"}', b"\xff" * 100, b"[" * 10_000, b"null"):
            scheduler.bus._session.put(key, garbage)  # pyright: ignore
        scheduler.ask(card, task_id="t2", boot_id="boot-0")
        scheduler.ask(card, task_id="t3", deadline=time.time() - 5)
        assert "earlier life" in ((await scheduler.until("t2", SkillStatusKind.REFUSED)).reason or "")
        assert "deadline" in ((await scheduler.until("t3", SkillStatusKind.REFUSED)).reason or "")
        assert history(tmp_path, "start") == []
        scheduler.ask(card, task_id="t4")
        await scheduler.until("t4", SkillStatusKind.SUCCEEDED)


async def test_a_second_agent_of_the_same_robot_gives_way(router: RouterProcess, tmp_path: Path) -> None:
    """It exits with a clear message, and the first one is not disturbed."""
    async with listening(router) as scheduler, service_process(MODULE, router, environment(tmp_path)) as first:
        await scheduler.card()
        async with service_process(MODULE, router, environment(tmp_path / "other"), wait=False) as second:
            assert await second.ended(240) == ALREADY_RUNNING_EXIT
            assert f"robot {T1} is already running" in second.output
        assert first.exit_code is None


async def test_a_lost_scheduler_holds_the_machine_until_one_is_back(router: RouterProcess, tmp_path: Path) -> None:
    """A short loss is driven through; after ten seconds the machine holds still, and goes on when one is there."""
    settings = environment(tmp_path, factor="0.2")
    async with listening(router) as scheduler, service_process(MODULE, router, settings):
        card = await scheduler.card()
        async with scheduler.bus.alive(SERVICE_ALIVE, service="scheduler", boot_id=scheduler.bus.boot_id):
            scheduler.ask(card)
            await scheduler.until_driving()
        await eventually(lambda: "no scheduler" in (scheduler.states[T1].fault or ""), 240)
        await eventually(lambda: abs(scheduler.states[T1].speed_mps) < 0.05, 240)
        at = scheduler.states[T1].pose
        assert scheduler.states[T1].busy_with is not None
        async with scheduler.bus.alive(SERVICE_ALIVE, service="scheduler", boot_id=scheduler.bus.boot_id):
            await eventually(lambda: scheduler.states[T1].pose.distance(at) > 0.5, 240)
            assert scheduler.states[T1].fault is None


async def test_one_process_hosts_several_kinematic_robots(router: RouterProcess, tmp_path: Path) -> None:
    """Each has its own card, journal and work."""
    async with listening(router) as scheduler, service_process(MODULE, router, environment(tmp_path, f"{T1},{T2}")):
        cards = [await scheduler.card(T1), await scheduler.card(T2)]
        for number, card in enumerate(cards):
            scheduler.ask(card, task_id=f"t{number}", goals=[{"x": -10, "y": -18 + 6 * number, "yaw": 0}])
        for number in range(2):
            await scheduler.until(f"t{number}", SkillStatusKind.SUCCEEDED)
    assert journals(tmp_path) == {f"agent-{T1}.sqlite3", f"agent-{T2}.sqlite3"}


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"MUSTER_ROBOT_ID": "no_such_robot"}, "no_such_robot"),
        ({"MUSTER_ROBOT_ID": "../../etc"}, "MUSTER_ROBOT_ID"),
        ({"MUSTER_ROBOT_ID": f"{T1},{T2}", "MUSTER_DRIVER": "sim"}, "kinematic"),
        ({"MUSTER_SPEED_FACTOR": "0"}, "MUSTER_SPEED_FACTOR"),
    ],
)
async def test_settings_that_cannot_be_used_are_named(
    router: RouterProcess, tmp_path: Path, settings: dict[str, str], word: str
) -> None:
    """It ends at once and says which setting is wrong."""
    async with service_process(MODULE, router, {**environment(tmp_path), **settings}, wait=False) as agent:
        assert await agent.ended(240) == BAD_SETTINGS_EXIT
        assert word in agent.output


async def test_an_agent_asked_to_stop_leaves_in_order(router: RouterProcess, tmp_path: Path) -> None:
    """SIGTERM in mid-drive: exit code 0, and the next life reports the drive as interrupted."""
    async with listening(router) as scheduler:
        agent: Process
        async with service_process(MODULE, router, environment(tmp_path, factor="0.3")) as agent:
            scheduler.ask(await scheduler.card())
            await scheduler.until_driving()
            agent.signal(signal.SIGTERM)
            assert await agent.ended() == 0
        async with service_process(MODULE, router, environment(tmp_path)):
            await scheduler.until("t1", SkillStatusKind.INTERRUPTED)
