"""One robot's agent: the shell around core, skills and driver. All its work happens in one event loop."""

import asyncio
import time
from contextlib import aclosing
from typing import Any, Final

import structlog
from muster_bus import Bus, crash
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
from muster_schemas.robot import RobotCard, RobotState, SkillStatusKind
from muster_schemas.sim import Telemetry
from muster_schemas.stops import StopRequest, StopStatus

from .core import Begin, Continue, Core, Effect, Halt, Hold, Save, Say
from .drivers.port import Driver
from .history import History
from .journal import Journal
from .machine import Machine
from .skills.execution import SKILLS, SkillRun
from .stops import StopBook
from .surroundings import SiteView, Surroundings
from .watching import Watch

STATE_EVERY_SITE_S: Final = 0.2
STATE_AT_MOST_EVERY_S: Final = 0.04
STATE_AT_LEAST_EVERY_S: Final = 0.3
HOUSEKEEPING_S: Final = 0.1
NO_TELEMETRY: Final = "the machine sends no telemetry"
RESTARTED_S: Final = 1.0
"""A machine's clock that is set back by more than this has begun anew."""

STOP: Final = "stop"
"""The journal's name for the newest stop order."""

_log = structlog.stdlib.get_logger(__name__)


class RobotAgent:
    """Speaks for one robot as long as `run` runs."""

    def __init__(
        self, bus: Bus, view: SiteView, robot_id: str, driver: Driver, journal: Journal, history: History
    ) -> None:
        card = view.site.card(robot_id, bus.boot_id)
        kind = view.site.robot_types[card.type]
        self.card: RobotCard = card.model_copy(update={"skills": tuple(s for s in card.skills if s in SKILLS)})
        self._bus = bus
        self._kind = kind
        self._surroundings = Surroundings(view, robot_id)
        self._driver = driver
        self._journal = journal
        self._history = history
        self._core = Core(robot_id, bus.boot_id, self.card.skills, attempts=journal.attempts(), epoch=journal.epoch())
        self._stop = StopBook.kept(journal.number(STOP))
        self._said_standing = True
        """Whether the newest stop has been answered with the machine at a stand."""
        self._machine: Machine | None = None
        self._run: SkillRun | None = None
        self._watch = Watch(time.monotonic())
        self._fault: str | None = None
        self._seq = 0
        self._state_site_s = self._state_at = float("-inf")
        self._kept_arrival: tuple[float, float] | None = None
        self._log: Any = _log.bind(robot_id=robot_id)

    async def run(self) -> None:
        """Work until cancelled, then leave the machine standing still."""
        self._carry_out(self._core.recover(time.time()))
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._follow_machine())
                tasks.create_task(self._follow_requests())
                tasks.create_task(self._follow_stops())
                tasks.create_task(self._follow_acks())
                tasks.create_task(self._follow_scheduler())
                tasks.create_task(self._keep_house())
        finally:
            if self._machine is not None and self._run is not None:
                self._machine.hold()
                self._driver.apply(self._machine.order(), self._machine.telemetry.site_time_s)

    async def _follow_requests(self) -> None:
        async with self._bus.subscribe(SKILL_REQUEST, robot_id=self.card.robot_id) as messages:
            async for received in messages:
                if received.message is not None:
                    self._carry_out(self._core.request(received.message, time.time(), self._hindrance))

    async def _follow_stops(self) -> None:
        async with self._bus.subscribe(ROBOT_STOP, robot_id=self.card.robot_id) as messages:
            async for received in messages:
                if received.message is not None and received.message.robot_id == self.card.robot_id:
                    self._on_stop(received.message)

    @property
    def _hindrance(self) -> str | None:
        """Why nothing can be started now, or None."""
        if self._stop.stopped:
            return "a person has stopped this robot; release it first"
        return NO_TELEMETRY if self._machine is None or self._watch.machine_is_late else None

    async def _follow_acks(self) -> None:
        async with self._bus.subscribe(STATUS_ACK, robot_id=self.card.robot_id) as messages:
            async for received in messages:
                if received.message is not None:
                    self._carry_out(self._core.acked(received.message))

    async def _follow_scheduler(self) -> None:
        lives: set[str] = set()
        async with self._bus.watch(SERVICE_ALIVE, service="scheduler") as changes:
            async for change in changes:
                (lives.add if change.alive else lives.discard)(change.ids["boot_id"])
                self._watch.scheduler_there = bool(lives)

    async def _follow_machine(self) -> None:
        async with aclosing(self._driver.telemetry()) as stream:
            async for telemetry in stream:
                self._on_telemetry(telemetry)

    async def _keep_house(self) -> None:
        while True:
            await asyncio.sleep(HOUSEKEEPING_S)
            now = time.monotonic()
            self._watch.look(now, connected=self._bus.connected)
            self._carry_out(self._core.tick(time.time()))
            fault = self._watch.must_hold
            if self._machine is not None and self._watch.machine_is_late:
                fault = NO_TELEMETRY
                if self._run is not None and self._watch.machine_is_gone:
                    self._run.give_up(fault)
                    self._finish(self._run)
            if fault != self._fault:
                self._log.warning("fault" if fault else "fault_over", fault=fault)
            self._fault = fault
            if now - self._state_at > STATE_AT_LEAST_EVERY_S:
                self._publish_state(now)

    def _on_telemetry(self, telemetry: Telemetry) -> None:
        """Do one step of control: the only place where the machine is moved."""
        self._watch.telemetry_at = time.monotonic()
        machine = self._machine
        if machine is not None and telemetry.site_time_s < machine.telemetry.site_time_s - RESTARTED_S:
            self._log.warning("machine_restarted")
            if self._run is not None:
                self._run.give_up("the machine restarted")
                self._finish(self._run)
            machine = self._machine = None
            self._state_site_s = float("-inf")
        if machine is None:
            machine = self._meet(telemetry)
        run = self._run
        if run is None:
            machine.sense(telemetry)
        else:
            order = run.step(telemetry, suspended=self._stop.stopped or self._watch.must_hold is not None)
            self._driver.apply(order, telemetry.site_time_s)
            self._report(run, machine)
        if self._stop.stopped and not self._said_standing and self._why_not_standing is None:
            self._say_stop()
        self._keep_arrival(machine)
        now = time.monotonic()
        due = telemetry.site_time_s - self._state_site_s >= STATE_EVERY_SITE_S - 1e-6
        if due and now - self._state_at >= STATE_AT_MOST_EVERY_S:
            self._state_site_s = telemetry.site_time_s
            self._publish_state(now)

    def _on_stop(self, request: StopRequest) -> None:
        after = self._stop.after(request, busy=self._run is not None)
        if after is not self._stop:
            self._journal.keep_number(STOP, after.kept_number)
            self._stop = after
            self._log.warning("stopped" if after.stopped else "released", number=after.number)
        self._say_stop()

    def _say_stop(self) -> None:
        why_not = self._why_not_standing
        self._said_standing = why_not is None
        status = StopStatus(
            robot_id=self.card.robot_id,
            boot_id=self._bus.boot_id,
            number=self._stop.number,
            stopped=self._stop.stopped,
            standing=why_not is None,
            was_busy=self._stop.was_busy,
            busy_with=self._core.active,
            reason=why_not,
            at=time.time(),
        )
        self._bus.publish(ROBOT_STOP_STATUS, status, robot_id=self.card.robot_id)

    @property
    def _why_not_standing(self) -> str | None:
        """Why the machine may still move, or None if it stands."""
        if self._machine is None or self._watch.machine_is_late:
            return NO_TELEMETRY
        held = self._run is None or self._run.holds
        return None if held and self._machine.still else "it is coming to a stand"

    def _meet(self, telemetry: Telemetry) -> Machine:
        machine = self._machine = Machine(self.card, self._kind, self._surroundings, telemetry)
        soil, bodies = self._journal.number("arrival_soil_m3"), self._journal.number("arrival_bodies")
        if soil is not None and bodies is not None:
            machine.arrival_soil_m3 = min(soil, machine.load.soil_m3)
            machine.arrival_bodies = min(int(bodies), len(machine.load.bodies))
        self._bus.publish(ROBOT_CARD, self.card, robot_id=self.card.robot_id)
        self._log.info("ready", skills=len(self.card.skills))
        return machine

    def _keep_arrival(self, machine: Machine) -> None:
        """Remember across restarts what the load was on arrival: a loading is judged by it."""
        arrival = (machine.arrival_soil_m3, float(machine.arrival_bodies))
        if arrival != self._kept_arrival:
            self._kept_arrival = arrival
            self._journal.keep_number("arrival_soil_m3", arrival[0])
            self._journal.keep_number("arrival_bodies", arrival[1])

    def _report(self, run: SkillRun, machine: Machine) -> None:
        if run.outcome is not None:
            self._finish(run)
        elif run.held:
            self._carry_out(self._core.held(run.request.ref, time.time()))
        else:
            self._carry_out(self._core.progressed(run.request.ref, machine.progress, time.time()))

    def _finish(self, run: SkillRun) -> None:
        outcome, request = run.outcome, run.request
        if outcome is None:
            return
        self._run = None
        crash.point("end")
        self._history.write("end", self.card.robot_id, request.ref, request.skill, self._site_time_s)
        self._log.info("ended", **_named(request), state=outcome.state, reason=outcome.reason)
        self._carry_out(self._core.ended(request.ref, outcome.state, outcome.reason, time.time()))

    @property
    def _site_time_s(self) -> float:
        return self._machine.telemetry.site_time_s if self._machine else 0.0

    def _carry_out(self, effects: list[Effect]) -> None:
        """Carry out in order; if the journal cannot be written, the error ends the process before anything moves."""
        for effect in effects:
            match effect:
                case Save(attempt, epoch):
                    crash.point("commit")
                    self._journal.save(attempt, epoch)
                    crash.point("committed")
                case Say(status):
                    crash.point("send")
                    self._bus.publish(SKILL_STATUS, status, robot_id=self.card.robot_id, skill=status.skill)
                    if status.state is SkillStatusKind.REFUSED:
                        self._log.warning("refused", reason=status.reason, **_named(status))
                case Begin():
                    self._begin(effect)
                case Halt():
                    if self._run is not None:
                        self._run.cancel()
                case Hold():
                    if self._run is not None:
                        self._run.pause()
                case Continue():
                    if self._run is not None:
                        self._run.resume()

    def _begin(self, begin: Begin) -> None:
        request, machine = begin.request, self._machine
        if machine is None:
            # `hindrance` refuses a start while there is no machine
            raise RuntimeError("a skill was started before the machine was met")
        self._history.write("start", self.card.robot_id, request.ref, request.skill, self._site_time_s)
        self._log.info("started", **_named(request))
        crash.point("begin")
        self._run = SkillRun(machine, request)
        self._driver.apply(machine.order(), machine.telemetry.site_time_s)  # a machine at rest is felt again at once
        crash.point("begun")

    def _publish_state(self, now: float) -> None:
        machine = self._machine
        if machine is None:
            return
        self._state_at = now
        self._seq += 1
        state = RobotState(
            robot_id=self.card.robot_id,
            boot_id=self._bus.boot_id,
            seq=self._seq,
            pose=machine.pose,
            speed_mps=machine.telemetry.speed_mps,
            load=machine.load,
            busy_with=self._core.active,
            path=machine.path,
            rules_revision=self._surroundings.rules.revision,
            fault=self._fault,
            stopped=self._stop.stopped,
            at=time.time(),
        )
        self._bus.publish(ROBOT_STATE, state, robot_id=self.card.robot_id)


def _named(message: Any) -> dict[str, object]:
    return {"mission": message.mission_id, "task": message.task_id, "attempt": message.attempt, "skill": message.skill}
