"""The machines: each does one thing at a time and tells the history what its body really did.

A skill takes as long and ends as its seed says. A machine whose agent has gone halts, as every driver makes it.
"""

import asyncio
import random
from collections.abc import AsyncGenerator
from dataclasses import dataclass, field

from muster_robot_agent.machine import Machine, Order
from muster_robot_agent.skills.execution import Outcome
from muster_schemas.base import Pose
from muster_schemas.robot import Load, SkillRequest, SkillStatusKind
from muster_schemas.sim import Telemetry

from .history import History, Motion

TELEMETRY_S = 0.25
STOPS_WITHIN_S = 0.5
RULES_WAIT_S = 20.0
FAILS = 0.06
"""The share of attempts that fail by themselves."""


@dataclass
class Body:
    """One robot's hardware, which outlives its agent."""

    robot_id: str
    pose: Pose
    history: History
    seed: int
    doing: list["ScriptedRun"] = field(default_factory=list["ScriptedRun"])
    """What its agent makes it do; more than one is what must never be."""
    seq: int = 0

    def note(self, what: str, run: "ScriptedRun", outcome: str = "") -> None:
        """Tell the history."""
        request = run.request
        now = asyncio.get_running_loop().time()
        motion = Motion(now, what, self.robot_id, request.ref, request.epoch, outcome, request)  # type: ignore[arg-type]
        self.history.add(motion)

    def halt(self) -> None:
        """Stand still: nobody commands any more."""
        for run in self.doing:
            self.note("halt", run)
        self.doing.clear()

    def sense(self) -> Telemetry:
        """Return what it senses."""
        self.seq += 1
        return Telemetry.model_construct(
            robot_id=self.robot_id,
            seq=self.seq,
            site_time_s=asyncio.get_running_loop().time(),
            pose=self.pose,
            speed_mps=0.0,
            turn_radps=0.0,
            joints={},
            load=Load(),
            touching=(),
        )


class BodyDriver:
    """One agent's hold on the hardware: the `Driver` port."""

    def __init__(self, body: Body) -> None:
        self.body = body

    async def telemetry(self) -> AsyncGenerator[Telemetry]:
        """Yield what the machine senses."""
        while True:
            yield self.body.sense()
            await asyncio.sleep(TELEMETRY_S)

    def apply(self, order: Order, site_time_s: float) -> None:
        """Do nothing: a scripted run moves its body itself."""


class Bodies:
    """All hardware of a site, and the runs that agents begin on it; stands where the agent has its `SkillRun`."""

    def __init__(self, bodies: dict[str, Body]) -> None:
        self.by_robot = bodies

    def __call__(self, machine: Machine, request: SkillRequest) -> "ScriptedRun":
        """Begin an attempt: the physical start."""
        return ScriptedRun(self.by_robot[request.robot_id], machine, request)


class ScriptedRun:
    """One attempt on one machine, as the agent's shell sees a `SkillRun`."""

    def __init__(self, body: Body, machine: Machine, request: SkillRequest) -> None:
        self.request = request
        self.outcome: Outcome | None = None
        self.held = False
        self._body = body
        self._machine = machine
        machine.note, machine.progress = None, 0.0
        rng = random.Random(f"{body.seed} {body.robot_id} {request.ref}")
        self._fails = rng.random() < FAILS
        self._takes_s = rng.choices([0.2, 0.5, 1.0, 2.0, 4.0, 40.0], [6, 6, 6, 6, 6, 1])[0]
        self._done_s = 0.0
        self._last = asyncio.get_running_loop().time()
        self._paused = self._cancelled = False
        body.doing.append(self)
        body.note("start", self)

    def step(self, telemetry: Telemetry, *, suspended: bool = False) -> Order:
        """Let the time since the last step have had its effect."""
        machine = self._machine
        machine.sense(telemetry)
        now = asyncio.get_running_loop().time()
        passed, self._last = now - self._last, now
        if self._cancelled:
            self._end(SkillStatusKind.CANCELLED)
            return machine.order()
        if self._paused or suspended:
            self.held = self._paused
            return machine.order()
        self._done_s += passed
        if self.request.rules_revision is not None:
            if machine.surroundings.rules.revision >= self.request.rules_revision:
                self._end(SkillStatusKind.SUCCEEDED)
            elif self._done_s > RULES_WAIT_S:
                self._end(SkillStatusKind.FAILED, "the area rules did not arrive")
        else:
            machine.progress = min(1.0, self._done_s / self._takes_s)
            if self._done_s >= self._takes_s:
                self._move()
                self._end(SkillStatusKind.FAILED if self._fails else SkillStatusKind.SUCCEEDED, "as scripted")
        return machine.order()

    def pause(self) -> None:
        """Hold still until `resume`."""
        self._paused = True

    def resume(self) -> None:
        """Go on."""
        self._paused = self.held = False

    def cancel(self) -> None:
        """Come to a halt with the next step."""
        self._cancelled = True

    def give_up(self, reason: str) -> None:
        """End at once."""
        self._end(SkillStatusKind.CANCELLED if self._cancelled else SkillStatusKind.FAILED, reason)

    def _move(self) -> None:
        if self.request.goals:
            self._body.pose = self.request.goals[-1]

    def _end(self, state: SkillStatusKind, reason: str | None = None) -> None:
        self.outcome = Outcome(state, reason)
        if self in self._body.doing:
            self._body.doing.remove(self)
            self._body.note("end", self, state)
