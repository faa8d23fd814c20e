"""Testing support: a site in memory with ideal robots around the pure core, for tests and measurements."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from muster_schemas.ids import new_boot_id
from muster_schemas.mission import MissionState, MissionStatus, Reason, TaskState, TaskStatus
from muster_schemas.plan import PlanTask
from muster_schemas.robot import SkillRequest, SkillStatus, SkillStatusKind, TaskRef
from muster_schemas.rpc import ControlMission, MissionAction, ReplanMission
from muster_schemas.site import Site, Thing
from muster_schemas.stops import StopRequest, StopStatus
from muster_schemas.world import MapObject

from .core.core import Core
from .core.effects import AskPlanner, Effect, Hush, HushStop, PublishMission, PublishTask, Send, SendStop
from .core.events import (
    AnyEvent,
    MissionControlled,
    MissionReplanned,
    MissionSubmitted,
    ObjectsChanged,
    Policy,
    RobotOffline,
    RobotOnline,
    Started,
    StatusReceived,
    StopObeyed,
    StopOrdered,
    Tick,
)
from .core.invariants import validate
from .core.queue import TaskKey
from .core.state import Mission, Task
from .policy.assignment import Assignment
from .policy.decide import advance
from .policy.search import Limits
from .policy.world import World

STEPS = Limits(seconds=math.inf, steps=300)
"""Tests count the optimiser's steps and not its time, so they always see the same."""
Function = Mapping[str, Any]


def planned(name: str, skill: str, robots: Sequence[str] = (), after: Sequence[str] = (), **rest: Any) -> PlanTask:
    """Return one task of a plan: `rest` may hold `objects`, `types` and `count`."""
    function = {
        "name": skill,
        "robot_ids": list(robots),
        "robot_type": rest.get("types", []),
        "robot_count": rest.get("count"),
        "dependencies": list(after),
        "object_keywords": rest.get("objects", []),
    }
    return PlanTask.model_validate({"task": name, "instruction_function": function})


def as_seen(thing: Thing, at: float) -> MapObject:
    """Return what the cameras say of a thing in the site's file."""
    return MapObject.model_validate(
        {
            "name": thing.name,
            "class": thing.object_class,
            "position": thing.position,
            "size": {"length_m": 2 * thing.radius_m, "width_m": 2 * thing.radius_m},
            "confidence": 1.0,
            "seen_at": at,
        }
    )


class Yard:
    """The core of a site with all of its robots and objects; `ideal` robots do what they are asked at once."""

    def __init__(self, site: Site, *, check: bool = True, policy: Policy | None = None, limits: Limits = STEPS) -> None:
        self.site = site
        self.core = Core()
        self.world = World(bounds=site.bounds)
        self.assignment = Assignment(limits)
        self.events: list[AnyEvent] = []
        """All that the journal would hold."""
        self.outbox: dict[tuple[str, TaskRef], SkillRequest] = {}
        """What is being sent."""
        self.stops: dict[str, StopRequest] = {}
        """Stop orders that are being sent."""
        self.questions: dict[TaskKey, ReplanMission] = {}
        """What the planner is being asked, by the task that failed."""
        self.starts: list[tuple[str, TaskRef]] = []
        self.published: list[TaskState | MissionState] = []
        self.now = 1000.0
        self._check = check
        self._numbers = itertools.count(1)
        self._seq = itertools.count(1)
        self.boots: dict[str, str] = {}
        self.happen(Started(at=self.now, epoch=1, skills=site.skills, policy=policy or Policy()))

    def happen(self, event: AnyEvent) -> list[Effect]:
        """Let one event happen, with all decisions that follow."""
        events, effects = advance(self.core, event, self.world, self.assignment)
        self.events += events
        changed: dict[tuple[str, ...], PublishTask | PublishMission] = {}
        for effect in effects:
            match effect:
                case Send(request=request):
                    self.outbox[request.robot_id, request.ref] = request
                case Hush():
                    self.outbox.pop((effect.robot_id, effect.ref), None)
                case SendStop(request=request):
                    self.stops[request.robot_id] = request
                case AskPlanner(request=request):
                    self.questions[request.mission_id, request.task_id] = request
                case HushStop():
                    self.stops.pop(effect.robot_id, None)
                case PublishTask(task=task):
                    changed[task.key] = effect
                case PublishMission(mission=mission):
                    changed[mission.mission_id,] = effect
                case _:
                    pass
        if self._check:
            self.published += [effect.state for effect in changed.values()]
            validate(self.core.state)
        return effects

    def open(self) -> None:
        """Let all robots and things of the site's file be seen."""
        for robot in self.site.robots:
            self.robot_comes(robot.id)
        self.see(self.site)

    def see(self, site: Site, names: Iterable[str] | None = None) -> None:
        """Put things on the map, all of the site's unless `names` says which."""
        wanted = [t for t in site.things if names is None or t.name in set(names)]
        for thing in wanted:
            self.world.objects[thing.name] = as_seen(thing, self.now)
        self.happen(ObjectsChanged(at=self.now, appeared=tuple(t.name for t in wanted)))

    def lose_sight(self, name: str) -> None:
        """Take a thing off the map."""
        del self.world.objects[name]
        self.happen(ObjectsChanged(at=self.now, gone=(name,)))

    def robot_comes(self, robot_id: str) -> None:
        """Let a robot's agent start, or start again."""
        self.boots[robot_id] = f"{new_boot_id()}-{next(self._numbers)}"
        self.robot_back(robot_id)

    def robot_back(self, robot_id: str) -> None:
        """Let a robot be seen in its present life."""
        card = self.site.card(robot_id, self.boots[robot_id])
        self.world.poses.setdefault(robot_id, card.home)
        self.happen(RobotOnline(at=self.now, card=card))

    def robot_lost(self, robot_id: str) -> None:
        """Let a robot be lost."""
        self.happen(RobotOffline(at=self.now, robot_id=robot_id, reason="gone"))

    def stop(self, robot_id: str | None = None, *, stop: bool = True) -> None:
        """Let someone stop a robot or the site, or release it."""
        self.happen(StopOrdered(at=self.now, robot_id=robot_id, stop=stop))

    def obey_stop(self, robot_id: str, *, standing: bool = True, **rest: Any) -> None:
        """Let a robot answer the stop order that it is being sent."""
        order = self.stops[robot_id]
        status = StopStatus(
            robot_id=robot_id,
            boot_id=self.boots[robot_id],
            number=order.number,
            stopped=order.stopped,
            standing=standing,
            at=self.now,
            **rest,
        )
        self.happen(StopObeyed(at=self.now, status=status))

    def submit(self, *tasks: PlanTask, priority: int = 5, ask: bool = False) -> Mission:
        """Make a mission."""
        mission_id = f"m{next(self._numbers)}"
        self.happen(
            MissionSubmitted(
                at=self.now,
                mission_id=mission_id,
                text="do it",
                tasks=tasks or None,
                priority=priority,
                approval="ask" if ask else "auto",
            )
        )
        return self.core.state.missions[mission_id]

    def control(self, mission: Mission, action: MissionAction, **rest: Any) -> None:
        """Act on a mission."""
        control = ControlMission(mission_id=mission.mission_id, action=action, **rest)
        self.happen(MissionControlled(at=self.now, control=control))

    def answer(self, key: TaskKey, *plan: PlanTask, ask_because: tuple[str, ...] = ()) -> None:
        """Let the planner answer the question about a task: with a plan, or that it has none."""
        question = self.questions.pop(key)
        self.happen(
            MissionReplanned(
                at=self.now,
                mission_id=question.mission_id,
                task_id=question.task_id,
                number=question.number,
                tasks=plan or None,
                reasons=() if plan else (Reason(code="refused", message="No way."),),
                ask_because=ask_because,
            )
        )

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.now += seconds
        self.happen(Tick(at=self.now))

    def say(self, robot_id: str, task: Task, kind: SkillStatusKind, **rest: Any) -> list[Effect]:
        """Let a robot say something about the current attempt at a task."""
        attempt = rest.pop("attempt", task.attempt)
        status = SkillStatus(
            mission_id=task.mission_id,
            task_id=task.task_id,
            attempt=attempt,
            epoch=1,
            robot_id=robot_id,
            boot_id=rest.pop("boot_id", self.boots[robot_id]),
            skill=task.skill.name,
            seq=rest.pop("seq", next(self._seq)),
            state=kind,
            at=self.now,
            **rest,
        )
        return self.hear(status)

    def hear(self, status: SkillStatus) -> list[Effect]:
        """Let a status come in."""
        return self.happen(StatusReceived(at=self.now, status=status))

    def all_say(self, task: Task, kind: SkillStatusKind, **rest: Any) -> None:
        """Let all robots of a task say the same."""
        for robot_id in task.robots:
            self.say(robot_id, task, kind, **rest)

    def finish(self, task: Task) -> None:
        """Let all robots of a task start and succeed; they then stand at their goals."""
        self.all_say(task, SkillStatusKind.STARTED)
        for run in task.runs.values():
            if run.order.goals:
                self.world.poses[run.robot_id] = run.order.goals[-1]
        self.all_say(task, SkillStatusKind.SUCCEEDED)

    def run(self, mission: Mission, seconds: float = 600.0) -> None:
        """Let ideal robots carry out a mission to its end, one task after the other in the order of dispatch."""
        give_up = self.now + seconds
        while not mission.state.ended and self.now < give_up:
            running = sorted(mission.active)
            for task_id in running:
                task = mission.tasks[task_id]
                self.starts += [(r, task.ref) for r in task.runs if (r, task.ref) in self.outbox]
                self.finish(task)
            if not running:
                self.wait(1.0)

    def tasks(self, mission: Mission, *states: TaskStatus) -> list[str]:
        """Return the names of a mission's tasks in these states."""
        return [t.name for t in mission.tasks.values() if t.state in states]

    @staticmethod
    def ended_well(mission: Mission) -> bool:
        """Return whether a mission succeeded."""
        return mission.state is MissionStatus.SUCCEEDED


def replayed(events: Iterable[AnyEvent], core: Core | None = None) -> Core:
    """Return a core, by default a new one, that has lived through events without anyone deciding anything."""
    core = core or Core()
    for event in events:
        core.handle(event)
    return core


def yard_file() -> Path:
    """Return the default site's file in this checkout."""
    return Path(__file__).parents[4] / "sites" / "yard.yaml"
