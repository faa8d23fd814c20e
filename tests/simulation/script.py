"""What happens to a site in one run: steps drawn from a seed, which can be cut down to the few that matter."""

import random
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from muster_schemas.channels import SKILL_REQUEST, SKILL_STATUS, STATUS_ACK
from muster_schemas.plan import PlanTask
from muster_schemas.robot import RequestAction, SkillRequest, SkillStatus, SkillStatusKind, StatusAck
from muster_schemas.rpc import MissionAction

from .network import Noise
from .site import ROBOTS, SITE, Yard
from .virtual import BEGIN
from .workload import random_plan

HORIZON_S: Final = 24.0
"""Trouble comes within this long."""


@dataclass(frozen=True)
class Step(ABC):
    """Something that happens at a moment."""

    at: float

    @abstractmethod
    def happen(self, yard: Yard) -> None:
        """Do it."""


@dataclass(frozen=True)
class Submit(Step):
    """The operator submits a mission."""

    number: int
    tasks: tuple[PlanTask, ...]
    priority: int = 5
    ask: bool = False
    later: bool = False

    def happen(self, yard: Yard) -> None:
        """Do it."""
        yard.trouble(f"the operator submits mission {self.number} ({len(self.tasks)} tasks)")
        yard.operate(yard.submit(self.number, self.tasks, self.priority, ask=self.ask, later=self.later))

    def __str__(self) -> str:
        said = [
            f"{t.task}={t.instruction_function.name}"
            f"({','.join(t.instruction_function.robot_ids) or t.instruction_function.robot_type}"
            f" x{t.instruction_function.robot_count} at {','.join(t.instruction_function.object_keywords)})"
            f" after {list(t.instruction_function.dependencies)}"
            for t in self.tasks
        ]
        return f"{self.at:.2f} submit mission {self.number} ask={self.ask} later={self.later}: {'; '.join(said)}"


@dataclass(frozen=True)
class Control(Step):
    """The operator acts on a mission."""

    number: int
    action: MissionAction

    def happen(self, yard: Yard) -> None:
        """Do it."""
        yard.trouble(f"the operator says {self.action} to mission {self.number}")
        yard.operate(yard.control(self.number, self.action))


@dataclass(frozen=True)
class Kill(Step):
    """A process dies, `places` places after the moment."""

    who: str
    places: int
    back_after_s: float
    forgets: bool = False
    place: str | None = None
    """Only places of this name count."""
    loses_words: bool = False

    def happen(self, yard: Yard) -> None:
        """Do it."""
        process = yard.processes[self.who]
        lost = ", its disk is lost" if self.forgets else ", its last words are lost" if self.loses_words else ""
        yard.trouble(f"kill -9 {self.who} at place {self.places} of {self.place or 'any name'}{lost}")
        process.places_left, process.place = self.places, self.place
        process.loses_words = self.loses_words
        process.restart_after_s = self.back_after_s
        process.forgets = self.forgets


@dataclass(frozen=True)
class Cut(Step):
    """A process is cut off from the router, one way or both."""

    for_s: float
    who: str
    out: bool
    into: bool
    held: bool
    noticed: bool

    def happen(self, yard: Yard) -> None:
        """Do it."""
        bus = yard.processes[self.who].bus
        if bus is None:
            return
        way = "both ways" if self.out and self.into else "outward" if self.out else "inward"
        yard.trouble(f"{self.who} is cut off {way} for {self.for_s:.1f} s{', messages wait' if self.held else ''}")
        yard.network.cut(bus, out=self.out, into=self.into, held=self.held, noticed=self.noticed)
        yard.later(self.for_s, lambda: None if bus.dead else yard.network.heal(bus))


@dataclass(frozen=True)
class Spoil(Step):
    """The network spoils single messages for a while."""

    for_s: float
    noise: Noise

    def happen(self, yard: Yard) -> None:
        """Do it."""
        yard.trouble(f"the network has {self.noise} for {self.for_s:.1f} s")
        noise = yard.network.noise = self.noise

        def end() -> None:
            if yard.network.noise is noise:
                yard.network.noise = Noise()
                for bus in tuple(yard.network.buses):
                    yard.network.mend(bus)

        yard.later(self.for_s, end)


@dataclass(frozen=True)
class Jump(Step):
    """A process's wall clock is set."""

    who: str
    by_s: float

    def happen(self, yard: Yard) -> None:
        """Do it."""
        yard.trouble(f"the wall clock of {self.who} jumps by {self.by_s:+.0f} s")
        yard.processes[self.who].clock.wall_ahead_s += self.by_s


@dataclass(frozen=True)
class FillDisk(Step):
    """A process's disk is full for a while."""

    for_s: float
    who: str

    def happen(self, yard: Yard) -> None:
        """Do it."""
        yard.trouble(f"the disk of {self.who} is full for {self.for_s:.1f} s")
        process = yard.processes[self.who]
        process.disk_full = True

        def free() -> None:
            process.disk_full = False

        yard.later(self.for_s, free)


@dataclass(frozen=True)
class Hide(Step):
    """An object leaves the map for a while."""

    for_s: float
    name: str

    def happen(self, yard: Yard) -> None:
        """Do it."""
        yard.trouble(f"{self.name} leaves the map for {self.for_s:.1f} s")
        yard.hide(self.name)
        yard.later(self.for_s, lambda: yard.show(self.name))


@dataclass(frozen=True)
class Foreign(Step):
    """A message comes that the site's own scheduler or agents have not sent now: old, false, or of another epoch."""

    kind: str
    pick: float
    robot_id: str

    def happen(self, yard: Yard) -> None:
        """Do it."""
        if not yard.requests:
            return
        old = yard.requests[int(self.pick * len(yard.requests))]
        yard.trouble(f"a foreign message: {self.kind}, made of {old.action} {old.mission_id}/{old.task_id}")
        FOREIGN[self.kind](yard, old, self.robot_id)


def _replayed(yard: Yard, old: SkillRequest, _robot: str) -> None:
    """Send an old request again as it was."""
    yard.operator.publish(SKILL_REQUEST, old, robot_id=old.robot_id, skill=old.skill)


def _replayed_soon(yard: Yard, old: SkillRequest, _robot: str) -> None:
    """Send the last starts again, as a network that doubles and delays does."""
    recent = [r for r in yard.requests if r.deadline > BEGIN + yard.now and r.action is RequestAction.START]
    for request in recent or [old]:
        yard.operator.publish(SKILL_REQUEST, request, robot_id=request.robot_id, skill=request.skill)


def _former_scheduler(yard: Yard, old: SkillRequest, _robot: str) -> None:
    """Let a scheduler of an earlier epoch ask for a start of its own, once the agent knows a later one."""
    agent = yard.agents[old.robot_id]
    heard = [r for r in yard.history.heard(old.robot_id) if r.memory == agent.memory]
    highest = max((r.request.epoch for r in heard), default=1)
    if highest == 1 or agent.bus is None:
        return
    changed = {
        "action": RequestAction.START,
        "epoch": highest - 1,
        "attempt": old.attempt + 100,
        "boot_id": agent.bus.boot_id,
        "issued_at": BEGIN + yard.now,
        "deadline": BEGIN + yard.now + 1e5,
    }
    request = old.model_copy(update=changed)
    yard.operator.publish(SKILL_REQUEST, request, robot_id=old.robot_id, skill=old.skill)


def _other_life(yard: Yard, old: SkillRequest, _robot: str) -> None:
    """Ask for a start by a life of the agent that is over or never was."""
    changed = {"action": RequestAction.START, "attempt": old.attempt + 200, "boot_id": "boot-00000000000ffffffff"}
    request = old.model_copy(update={**changed, "deadline": BEGIN + yard.now + 1e5})
    yard.operator.publish(SKILL_REQUEST, request, robot_id=old.robot_id, skill=old.skill)


def _too_late(yard: Yard, old: SkillRequest, _robot: str) -> None:
    """Deliver a start whose time is long over."""
    agent = yard.agents[old.robot_id]
    if agent.bus is not None:
        changed = {"action": RequestAction.START, "attempt": old.attempt + 300, "boot_id": agent.bus.boot_id}
        request = old.model_copy(update={**changed, "deadline": BEGIN - 1e5})
        yard.operator.publish(SKILL_REQUEST, request, robot_id=old.robot_id, skill=old.skill)


def _status(old: SkillRequest, robot_id: str, **rest: object) -> SkillStatus:
    fields: dict[str, object] = {
        **old.ref.model_dump(),
        "epoch": old.epoch,
        "robot_id": robot_id,
        "boot_id": "boot-00000000000ffffffff",
        "skill": old.skill,
        "seq": 1000,
        "state": SkillStatusKind.SUCCEEDED,
        "at": BEGIN,
        **rest,
    }
    return SkillStatus.model_validate(fields)


def _word_of_a_former_life(yard: Yard, old: SkillRequest, _robot: str) -> None:
    """Claim success in the name of a life that is over."""
    yard.operator.publish(SKILL_STATUS, _status(old, old.robot_id), robot_id=old.robot_id, skill=old.skill)


def _word_of_another_robot(yard: Yard, old: SkillRequest, robot_id: str) -> None:
    """Claim success by a robot that was not asked, if it was not."""
    asked = any(r.ref == old.ref and r.robot_id == robot_id for r in yard.requests)
    if not asked:
        yard.operator.publish(SKILL_STATUS, _status(old, robot_id), robot_id=robot_id, skill=old.skill)


def _word_on_another_attempt(yard: Yard, old: SkillRequest, _robot: str) -> None:
    """Claim success of attempts that are not, and of missions that nobody knows."""
    for changed in ({"attempt": old.attempt + 400}, {"mission_id": "m-nobody"}, {"task_id": "t99"}):
        status = _status(old, old.robot_id, boot_id="boot-zzz", **changed)
        yard.operator.publish(SKILL_STATUS, status, robot_id=old.robot_id, skill=old.skill)


def _ack_of_another_seq(yard: Yard, old: SkillRequest, _robot: str) -> None:
    """Acknowledge what was not said yet."""
    ack = StatusAck(**old.ref.model_dump(), robot_id=old.robot_id, boot_id=old.boot_id, seq=0, epoch=old.epoch)
    yard.operator.publish(STATUS_ACK, ack, robot_id=old.robot_id, skill=old.skill)


FOREIGN: Final[dict[str, Callable[[Yard, SkillRequest, str], None]]] = {
    "an old request again": _replayed,
    "the last starts again": _replayed_soon,
    "a start by a former scheduler": _former_scheduler,
    "a start for another life": _other_life,
    "a start that is too late": _too_late,
    "a word of a former life": _word_of_a_former_life,
    "a word of another robot": _word_of_another_robot,
    "a word on another attempt": _word_on_another_attempt,
    "an ack of another word": _ack_of_another_seq,
}

PLACES: Final = {True: ("commit", "committed", "send", "sent"), False: ("commit", "committed", "begin", "begun", "end")}
"""Where schedulers (True) and agents die."""

Script = tuple[Step, ...]


def draw(seed: int) -> Script:
    """Return the script of a seed."""
    rng = random.Random(f"script of {seed}")
    steps: list[Step] = []
    missions = rng.randint(1, 4)
    for number in range(missions):
        plan = random_plan(rng, SITE)
        begin = rng.uniform(0.5, 12.0)
        flags = {"ask": rng.random() < 0.15, "later": rng.random() < 0.15}
        steps.append(Submit(begin, number, plan, rng.randint(0, 9), **flags))
        actions = rng.choices([0, 1, 2, 3], [5, 3, 2, 1])[0]
        for _ in range(actions):
            action = rng.choice(
                [MissionAction.PAUSE, MissionAction.RESUME, MissionAction.CANCEL, MissionAction.APPROVE]
            )
            steps.append(Control(rng.uniform(begin + 1.0, HORIZON_S), number, action))
    who = ("scheduler", "scheduler", *ROBOTS)
    for mission in [s for s in steps if isinstance(s, Submit) and rng.random() < 0.6]:
        # the moment that matters most: an agent dies just when it has begun or ended, and cannot say so any more
        named = [r for t in mission.tasks for r in t.instruction_function.robot_ids]
        place = rng.choices(("begin", "begun", "end"), [1, 3, 1])[0]
        back = rng.choice([0.1, 1.0, 4.0])
        steps.append(Kill(mission.at, rng.choice(named or ROBOTS), 1, back, place=place, loses_words=True))
    troubles = rng.randint(3, 10)
    steps += [_trouble(rng, rng.uniform(0.0, HORIZON_S), rng.choice(who)) for _ in range(troubles)]
    for kill in [s for s in steps if isinstance(s, Kill) and s.who == "scheduler" and rng.random() < 0.5]:
        at = min(kill.at + rng.uniform(2.0, 10.0), HORIZON_S)
        steps.append(Foreign(at, "a start by a former scheduler", rng.random(), rng.choice(ROBOTS)))
    return tuple(sorted(steps, key=lambda s: s.at))


def _trouble(rng: random.Random, at: float, who: str) -> Step:
    """Draw one trouble."""
    drawn = rng.choices([_kill, _cut, _spoil, _jump, _fill_disk, _hide, _foreign], [6, 4, 5, 1, 1, 1, 3])[0]
    return drawn(rng, at, who)


def _kill(rng: random.Random, at: float, who: str) -> Step:
    forgets = who != "scheduler" and rng.random() < 0.25
    back = rng.choice([0.1, 0.5, 1.0, 4.0, 8.0])
    if rng.random() < 0.4:
        return Kill(at, who, rng.randint(1, 25), back, forgets, loses_words=rng.random() < 0.3)
    place = rng.choice(PLACES[who == "scheduler"])
    return Kill(at, who, rng.randint(1, 2), back, forgets, place, loses_words=rng.random() < 0.5)


def _cut(rng: random.Random, at: float, who: str) -> Step:
    out, into = rng.choice([(True, True), (True, False), (False, True)])
    for_s = rng.choice([0.3, 1.0, 3.0, 6.0, 12.0])
    return Cut(at, for_s, who, out, into, held=rng.random() < 0.4, noticed=rng.random() < 0.4)


def _spoil(rng: random.Random, at: float, _who: str) -> Step:
    share = rng.choice([0.05, 0.2, 0.5])
    drop, double, late = (rng.choice([0.0, share]) for _ in range(3))
    return Spoil(at, rng.uniform(1.0, 8.0), Noise(drop, double, late, late_s=rng.choice([0.5, 3.0, 14.0])))


def _jump(rng: random.Random, at: float, who: str) -> Step:
    return Jump(at, who, rng.choice([-3600.0, -30.0, -5.0, 5.0, 30.0, 3600.0]))


def _fill_disk(rng: random.Random, at: float, who: str) -> Step:
    return FillDisk(at, rng.uniform(0.5, 5.0), who)


def _hide(rng: random.Random, at: float, _who: str) -> Step:
    return Hide(at, rng.uniform(0.5, 8.0), rng.choice(SITE.things).name)


def _foreign(rng: random.Random, at: float, who: str) -> Step:
    robot = who if who != "scheduler" else rng.choice(ROBOTS)
    return Foreign(at, rng.choice(list(FOREIGN)), rng.random(), robot)
