"""Everything the scheduler knows, as plain data. Only the core changes it; policy reads it.

What is marked `compare=False` is an index or a hint that can be rebuilt; the rest must equal the replay of the journal.
"""

from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from muster_schemas.mission import Approval, MissionStatus, Reason, TaskStatus
from muster_schemas.plan import PlanTask
from muster_schemas.policies import FailurePolicy
from muster_schemas.robot import (
    RequestAction,
    RobotCard,
    SkillStatusKind,
    TargetObject,
    TaskRef,
)
from muster_schemas.skills import PAPER_CATALOGUE
from muster_schemas.world import AreaRules
from pydantic import ConfigDict, Field

from .events import Order as RobotOrder
from .events import Policy
from .graph import TaskGraph
from .queue import Order, TaskKey, WaitQueue
from .stored import StoredCatalogue, StoredSkill

RULE_VERBS = frozenset({"avoid", "allow"})
"""Skills that change area rules: they take no time of the robot's own, so they run beside what it does."""
REPEATABLE_VERBS = frozenset({"go", "home", "avoid", "allow", "load"})
"""Skills of which a second start does no harm. A dig, dump or tip that was cut short has moved an unknown amount."""
STORY_LENGTH = 12


class Presence(StrEnum):
    """What is known of a robot's agent."""

    UNSEEN = "unseen"
    """Not heard of since this scheduler started."""
    ONLINE = "online"
    OFFLINE = "offline"


class Awaits(StrEnum):
    """Who has the next word on a task that failed."""

    DECISION = "decision"
    """A person: retry, skip, replan, or cancel the mission."""
    PLANNER = "replan"
    """The planner, with a new plan for it and what comes after it."""
    APPROVAL = "approval"
    """A person, who is to see that new plan first."""


@dataclass(slots=True, frozen=True)
class Selector:
    """Robots by type: `count` of each type, or all of them; no types mean the whole fleet."""

    types: tuple[str, ...]
    count: int | None

    @property
    def name(self) -> str:
        """Tell it from the other selectors of the mission; equal selectors mean the same robots."""
        return f"{self.count or 'all'} {' + '.join(self.types) or 'robots'}"


@dataclass(slots=True)
class Run:
    """One robot's part in the current attempt of a task."""

    robot_id: str
    boot_id: str
    order: RobotOrder
    state: SkillStatusKind | None = None
    """As its agent last said; None before its first word."""
    seq: int = -1
    progress: float = 0.0
    reason: str | None = None
    asked: tuple[RequestAction, str] | None = None
    """What is being sent, and to which life of the agent."""
    released: bool = False
    """It has been told to start, or says that it did: it may have moved."""
    lost: bool = False
    """Closed without the robot's word: what it does, or did, is not known."""

    @property
    def over(self) -> bool:
        """Whether nothing more will be heard of it that counts."""
        return self.state is not None and self.state.final

    @property
    def never_moved(self) -> bool:
        """Whether its robot has said that it did nothing."""
        return self.state in (SkillStatusKind.REFUSED, SkillStatusKind.UNKNOWN) and not self.lost

    @property
    def failed(self) -> bool:
        """Whether it is this robot that did not do its part (and not one that was only told to stop with it)."""
        return self.over and self.state not in (SkillStatusKind.SUCCEEDED, SkillStatusKind.CANCELLED)


@dataclass(slots=True)
class Task:
    """One node of a mission's graph."""

    mission_id: str
    task_id: str
    order: Order
    name: str
    skill: StoredSkill
    named: tuple[str, ...]
    selector: Selector | None
    objects: tuple[str, ...]
    dependencies: tuple[str, ...]
    unmet: set[str]
    state: TaskStatus = TaskStatus.WAITING
    robots: tuple[str, ...] = ()
    waiting_for: tuple[str, ...] = ()
    attempt: int = 0
    runs: dict[str, Run] = field(default_factory=dict[str, Run])
    targets: tuple[TargetObject, ...] = ()
    rules_revision: int | None = None
    closing: SkillStatusKind | None = None
    """Why the attempt is being ended at all of its robots; CANCELLED when the mission is cancelled."""
    closing_reason: str | None = None
    failures: int = 0
    refusals: int = 0
    hold_until: float | None = None
    """No start before then, after an attempt that did not work or while there is no room."""
    missing: set[str] = field(default_factory=set[str])
    """Objects that it needs and the map lacks."""
    give_up_at: float | None = None
    """When a wait for objects or room, or for an answer to a cancel, has lasted too long."""
    no_room: str | None = None
    kept_until: float | None = None
    """Its robots had better do something else until then."""
    kept_for: str | None = None
    """What they are kept for, as `waiting_for` says it."""
    error: str | None = None
    on_failure: FailurePolicy | None = None
    """Its own policy, of what the site's says otherwise."""
    measures: int = 0
    """How many of its policy's measures have been taken."""
    awaits: Awaits | None = None
    """It failed, and stays ready but still until someone says what now."""
    replan_number: int = 0
    """Of the newest question to the planner about it."""
    proposal: tuple[PlanTask, ...] | None = None
    """The planner's new plan for it and what comes after it, while that awaits approval."""
    excused: bool = False
    """A person goes on without it, or a new plan took its place: the mission may succeed all the same."""
    skipped_by_person: bool = False
    revision: int = 0
    ready_at: float | None = None
    started_at: float | None = None
    ended_at: float | None = None
    story: deque[str] = field(default_factory=lambda: deque(maxlen=STORY_LENGTH))

    def __post_init__(self) -> None:
        if self.story.maxlen is None:  # fresh from a snapshot
            self.story = deque(self.story, maxlen=STORY_LENGTH)

    @property
    def key(self) -> TaskKey:
        """Return what names it on the whole site."""
        return self.mission_id, self.task_id

    @property
    def ref(self) -> TaskRef:
        """Return what names the current attempt."""
        return TaskRef(mission_id=self.mission_id, task_id=self.task_id, attempt=self.attempt)

    @property
    def waived(self) -> bool:
        """Whether a person goes on without it, so that what depends on it may begin."""
        return self.state is TaskStatus.SKIPPED and self.skipped_by_person

    @property
    def active(self) -> bool:
        """Whether an attempt is under way."""
        return self.state in (TaskStatus.DISPATCHED, TaskStatus.RUNNING, TaskStatus.PAUSED)

    @property
    def is_team(self) -> bool:
        """Whether several robots do it, which start together and fail together."""
        return len(self.runs) > 1 and not self.is_rule

    @property
    def assembled(self) -> bool:
        """Whether all robots of the attempt have answered, none of them with a refusal."""
        return self.closing is None and all(r.state is not None for r in self.runs.values())

    @property
    def is_rule(self) -> bool:
        """Whether it changes area rules."""
        return self.skill.verb in RULE_VERBS

    @property
    def needs_objects(self) -> bool:
        """Whether its objects must be on the map; lifting a rule works for what has gone, too."""
        return bool(self.objects) and self.skill.verb != "allow"


@dataclass(slots=True)
class Mission:
    """What one instruction became."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)  # the graph, which is rebuilt

    mission_id: str
    number: int
    """Missions are numbered as they come."""
    text: str
    priority: int
    approval: Approval
    created_at: float
    state: MissionStatus = MissionStatus.PLANNING
    reasons: tuple[Reason, ...] = ()
    plan: tuple[PlanTask, ...] | None = None
    tasks: dict[str, Task] = field(default_factory=dict[str, Task])
    bound: dict[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """Selector's name -> its robots."""
    barred: dict[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])
    """Selector's name -> robots that it shall not mean (again), because they failed."""
    replans: int = 0
    """New plans that the planner was asked for."""
    plan_revision: int = 0
    """Grows with every change of the plan and with every new one that awaits approval."""
    approved: bool = False
    """A person has approved the plan."""
    open_tasks: int = 0
    unsuccessful: int = 0
    active: set[str] = field(default_factory=set[str])
    """Tasks with an attempt under way."""
    cancelling: bool = False
    stopping: dict[str, str] = field(default_factory=dict[str, str])
    """After a cancel: per robot, what is known."""
    idempotency_key: str | None = None
    revision: int = 0
    started_at: float | None = None
    ended_at: float | None = None
    urgency: float = 0.0
    """When it began to run, later by `Policy.ageing_s` for each step of priority below 9; the lowest goes first.

    So whoever waits becomes more urgent than ever more of those that come later, and no order among those that are
    there ever changes: nothing has to be sorted anew as time passes, and a replay needs no clock.
    """
    graph: Annotated[TaskGraph, Field(exclude=True)] = field(default_factory=lambda: TaskGraph({}), compare=False)
    named: frozenset[str] = frozenset()
    """Robots that the plan names."""
    selectors: frozenset[Selector] = frozenset()


@dataclass(slots=True)
class LooseEnd:
    """An attempt that is closed here but may still go on at the robot: it is told to stop until it answers."""

    ref: TaskRef
    skill: str
    asked: str | None = None


@dataclass(slots=True)
class StopOrder:
    """What a robot was told last: to stop, or to go on."""

    number: int
    stopped: bool
    obeyed_by: str | None = None
    """The life of its agent that has said so; None: it is not known."""
    was_busy: bool = False
    """Whether it was at work when the order came."""


@dataclass(slots=True)
class Robot:
    """A robot that has been on the site."""

    card: RobotCard
    presence: Presence = Presence.ONLINE
    holder: TaskKey | None = None
    """The task that it is reserved for."""
    lost_at: float | None = None
    """Since when it has been lost."""
    loose_ends: dict[TaskKey, LooseEnd] = field(default_factory=dict[TaskKey, LooseEnd])
    rules_revision: int = 0
    rule_tasks: dict[TaskKey, None] = field(default_factory=dict[TaskKey, None])
    """Tasks that wait for it to obey area rules."""
    stopped_alone: bool = False
    """Someone has stopped this robot, whatever holds for the whole site."""
    stop: StopOrder | None = None

    @property
    def stopped(self) -> bool:
        """Whether it has been told to stop and not been released since."""
        return self.stop is not None and self.stop.stopped

    @property
    def in_service(self) -> bool:
        """Whether work may be planned for it."""
        return self.presence is Presence.ONLINE and not self.stopped

    @property
    def free(self) -> bool:
        """Whether a task may have it now."""
        return self.in_service and self.holder is None and not self.loose_ends


@dataclass(slots=True)
class Agenda:
    """What policy should look at: tasks that may be able to start, robots that may have become free.

    And missions that begin, lose a task, or want a robot that came or went.
    """

    tasks: dict[TaskKey, None] = field(default_factory=dict[TaskKey, None])
    robots: dict[str, None] = field(default_factory=dict[str, None])
    missions: dict[str, None] = field(default_factory=dict[str, None])

    def __bool__(self) -> bool:
        return bool(self.tasks or self.robots or self.missions)


@dataclass(slots=True)
class State:
    """The whole."""

    now: float = 0.0
    epoch: int = 0
    policy: Policy = field(default_factory=Policy)
    catalogue: StoredCatalogue = field(default=PAPER_CATALOGUE, compare=False)
    submitted: int = 0
    """Missions ever."""
    missions: dict[str, Mission] = field(default_factory=dict[str, Mission])
    """Those that have not ended, and the newest that have; older ones are in the store's archive."""
    by_state: dict[MissionStatus, dict[str, None]] = field(default_factory=lambda: {s: {} for s in MissionStatus})
    by_idempotency_key: dict[str, str] = field(default_factory=dict[str, str])
    robots: dict[str, Robot] = field(default_factory=dict[str, Robot])
    objects: set[str] = field(default_factory=set[str])
    stopped: bool = False
    """Someone has stopped the whole site: the robots there are, and those yet to come."""
    stop_number: int = 0
    """Of the newest stop order."""
    rules: AreaRules = field(default_factory=lambda: AreaRules(revision=0))
    wanting_object: dict[str, dict[TaskKey, None]] = field(default_factory=dict[str, dict[TaskKey, None]])
    """Ready tasks by the objects that they need."""
    wanting_robot: dict[str, WaitQueue] = field(default_factory=dict[str, WaitQueue])
    """Ready tasks by each of their robots."""
    wanting_type: dict[str, WaitQueue] = field(default_factory=dict[str, WaitQueue])
    """Ready tasks whose selector is open, by type; under "" those that want the whole fleet."""
    timers: list[tuple[float, TaskKey]] = field(default_factory=list[tuple[float, TaskKey]], compare=False)
    """Heap of times at which a task may have to be looked at again."""
    agenda: Annotated[Agenda, Field(exclude=True)] = field(default_factory=Agenda, compare=False)

    def task(self, key: TaskKey) -> Task | None:
        """Return a task, or None if there is none such."""
        mission = self.missions.get(key[0])
        return mission.tasks.get(key[1]) if mission else None
