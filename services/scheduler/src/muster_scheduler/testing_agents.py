"""Testing support: simulated robots on a real bus, which obey at once, and may be told to misbehave."""

import asyncio
import contextlib
import time
from collections import Counter
from collections.abc import AsyncGenerator, Iterable

from muster_bus import Bus
from muster_schemas.base import Pose
from muster_schemas.channels import (
    OBJECT,
    ROBOT_ALIVE,
    ROBOT_CARD,
    ROBOT_STATE,
    ROBOT_STOP,
    ROBOT_STOP_STATUS,
    SKILL_REQUEST,
    SKILL_STATUS,
    STATUS_ACK,
)
from muster_schemas.ids import new_boot_id
from muster_schemas.robot import (
    RequestAction,
    RobotState,
    SkillRequest,
    SkillStatus,
    SkillStatusKind,
    TaskRef,
)
from muster_schemas.site import Site
from muster_schemas.stops import StopRequest, StopStatus

from .testing import as_seen

STATE_S = 0.2
REPEAT_S = 0.2


class SimulatedAgent:
    """One robot's agent. It keeps what it has been asked in memory and repeats final words until they are acked."""

    def __init__(self, bus: Bus, site: Site, robot_id: str) -> None:
        self.bus = bus
        self.card = site.card(robot_id, new_boot_id())
        self.robot_id = robot_id
        self.takes_s = 0.05
        """How long a skill takes."""
        self.copies = 1
        """How often each status is sent."""
        self.hold = asyncio.Event()
        """Skills end only while it is set."""
        self.hold.set()
        self.held: set[str] = set()
        """Tasks, by id, that do not end as long as they are in here."""
        self.started: Counter[TaskRef] = Counter()
        self.log: list[tuple[float, str, SkillRequest]] = []
        """(monotonic time, 'start' or 'end', request)"""
        self.requests: list[SkillRequest] = []
        self.unacked: dict[TaskRef, SkillStatus] = {}
        self.stop: StopRequest | None = None
        """The newest stop order."""
        self.fails: str | None = None
        """Why its skills fail, if they shall."""
        self.deaf = False
        """Whether it leaves stop orders unanswered."""
        self._last: dict[TaskRef, SkillStatus] = {}
        self._running: dict[TaskRef, asyncio.Task[None]] = {}
        self._prepared: set[TaskRef] = set()
        self._pose: Pose = self.card.home

    @contextlib.asynccontextmanager
    async def life(self) -> AsyncGenerator[None]:
        """Be there while entered."""
        ids = {"robot_id": self.robot_id}
        async with contextlib.AsyncExitStack() as stack:
            requests = await stack.enter_async_context(self.bus.subscribe(SKILL_REQUEST, **ids))
            stops = await stack.enter_async_context(self.bus.subscribe(ROBOT_STOP, **ids))
            acks = await stack.enter_async_context(self.bus.subscribe(STATUS_ACK, **ids))
            self.bus.publish(ROBOT_CARD, self.card, **ids)
            await stack.enter_async_context(self.bus.alive(ROBOT_ALIVE, boot_id=self.card.boot_id, **ids))

            async def obey() -> None:
                async for received in requests:
                    if received.message is not None:
                        self._obey(received.message)

            async def stand() -> None:
                async for received in stops:
                    if received.message is not None and not self.deaf:
                        self._obey_stop(received.message)

            async def hear() -> None:
                async for received in acks:
                    ack = received.message
                    if ack is not None:
                        ref = TaskRef(mission_id=ack.mission_id, task_id=ack.task_id, attempt=ack.attempt)
                        if ref in self.unacked and ack.seq >= self.unacked[ref].seq:
                            del self.unacked[ref]

            work = [asyncio.create_task(c) for c in (obey(), stand(), hear(), self._beat(), self._repeat())]
            try:
                yield
            finally:
                for task in (*work, *self._running.values()):
                    task.cancel()
                await asyncio.gather(*work, *self._running.values(), return_exceptions=True)

    def say(self, status: SkillStatus) -> None:
        """Publish a status, as often as this agent does."""
        for _ in range(self.copies):
            self.bus.publish(SKILL_STATUS, status, robot_id=self.robot_id, skill=status.skill)

    async def _beat(self) -> None:
        for seq in range(10**9):
            state = RobotState(
                robot_id=self.robot_id, boot_id=self.card.boot_id, seq=seq, pose=self._pose, at=time.time()
            )
            self.bus.publish(ROBOT_STATE, state, robot_id=self.robot_id)
            await asyncio.sleep(STATE_S)

    async def _repeat(self) -> None:
        while True:
            await asyncio.sleep(REPEAT_S)
            for status in tuple(self.unacked.values()):
                self.say(status)

    @property
    def stopped(self) -> bool:
        """Whether it must stand still."""
        return self.stop is not None and self.stop.stopped

    def _obey_stop(self, request: StopRequest) -> None:
        if self.stop is None or request.number > self.stop.number:
            self.stop = request
        status = StopStatus(
            robot_id=self.robot_id,
            boot_id=self.card.boot_id,
            number=self.stop.number,
            stopped=self.stop.stopped,
            standing=True,
            was_busy=bool(self._running),
            at=time.time(),
        )
        self.bus.publish(ROBOT_STOP_STATUS, status, robot_id=self.robot_id)

    def _obey(self, request: SkillRequest) -> None:
        self.requests.append(request)
        ref = request.ref
        if ref in self._last:
            if request.action is RequestAction.CANCEL and ref in self._prepared | set(self._running):
                if ref in self._running:
                    self._running.pop(ref).cancel()
                self._prepared.discard(ref)
                self._end(request, SkillStatusKind.CANCELLED)
            elif request.action is RequestAction.START and ref in self._prepared:
                self._prepared.discard(ref)
                self._start(request)
            else:
                self.say(self._last[ref])
        elif request.action not in (RequestAction.START, RequestAction.PREPARE):
            self._end(request, SkillStatusKind.UNKNOWN)
        elif request.boot_id != self.card.boot_id or self._running or self._prepared or self.stopped:
            self._end(request, SkillStatusKind.REFUSED, "busy, stopped or another life")
        elif request.action is RequestAction.PREPARE:
            self._prepared.add(ref)
            self._word(request, SkillStatusKind.ACCEPTED)
        else:
            self._start(request)

    def _start(self, request: SkillRequest) -> None:
        self.log.append((time.monotonic(), "start", request))
        self.started[request.ref] += 1
        self._word(request, SkillStatusKind.STARTED)
        self._running[request.ref] = asyncio.create_task(self._work(request))

    async def _work(self, request: SkillRequest) -> None:
        await asyncio.sleep(self.takes_s)
        await self.hold.wait()
        while self.stopped:  # noqa: ASYNC110  (a simulated machine)
            await asyncio.sleep(STATE_S)
        while request.task_id in self.held:  # noqa: ASYNC110  (a switch of tests)
            await asyncio.sleep(0.01)
        if request.goals:
            self._pose = request.goals[-1]
        self.log.append((time.monotonic(), "end", request))
        self._running.pop(request.ref, None)
        self._end(request, SkillStatusKind.FAILED if self.fails else SkillStatusKind.SUCCEEDED, self.fails)

    def _word(self, request: SkillRequest, kind: SkillStatusKind, reason: str | None = None) -> SkillStatus:
        known = self._last.get(request.ref)
        status = SkillStatus(
            mission_id=request.mission_id,
            task_id=request.task_id,
            attempt=request.attempt,
            epoch=request.epoch,
            robot_id=self.robot_id,
            boot_id=self.card.boot_id,
            skill=request.skill,
            seq=known.seq + 1 if known else 1,
            state=kind,
            reason=reason,
            at=time.time(),
        )
        self._last[request.ref] = status
        self.say(status)
        return status

    def _end(self, request: SkillRequest, kind: SkillStatusKind, reason: str | None = None) -> None:
        self.unacked[request.ref] = self._word(request, kind, reason)


@contextlib.asynccontextmanager
async def crew(bus: Bus, site: Site, robots: Iterable[str] | None = None) -> AsyncGenerator[dict[str, SimulatedAgent]]:
    """Run the agents of a site, all unless `robots` says which, and show its things on the map."""
    wanted = list(robots) if robots is not None else [r.id for r in site.robots]
    agents = {r: SimulatedAgent(bus, site, r) for r in wanted}
    for thing in site.things:
        bus.publish(OBJECT, as_seen(thing, time.time()), object_name=thing.name)
    async with contextlib.AsyncExitStack() as stack:
        for agent in agents.values():
            await stack.enter_async_context(agent.life())
        yield agents
