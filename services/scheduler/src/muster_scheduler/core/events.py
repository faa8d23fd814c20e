"""What can happen to the scheduler. Every event says when; ids that must be fresh come with it.

Events are what the journal holds, so a field may be added with a default but never be renamed or taken away.
"""

from typing import Annotated, Literal

from muster_schemas.base import Message, Pose, Seconds, UnixTime
from muster_schemas.ids import Id
from muster_schemas.mission import Approval, InstructionText, Priority, Reason
from muster_schemas.plan import PlanTask
from muster_schemas.policies import ApprovalRule, FailurePolicies
from muster_schemas.robot import RobotCard, SkillStatus, TargetObject
from muster_schemas.rpc import ControlMission
from muster_schemas.skills import Skill
from muster_schemas.stops import StopStatus
from muster_schemas.world import AreaRule
from pydantic import Field, TypeAdapter


class Policy(Message):
    """Limits of the failure policy; they travel in `Started`, so a replay uses what held at the time."""

    retries: int = Field(
        default=1, ge=0, description="new attempts after a failed one, for skills that may be repeated"
    )
    refusals: int = Field(default=20, ge=1, description="attempts refused in a row before the task fails")
    retry_after_s: Seconds = 1.0
    object_wait_s: Seconds = Field(default=60.0, description="how long a ready task waits for an object that has gone")
    room_wait_s: Seconds = Field(default=60.0, description="how long it waits for a free place at the object")
    cancel_wait_s: Seconds = Field(default=30.0, description="how long a live robot may leave a cancel unanswered")
    ageing_s: Seconds = Field(
        default=300.0, description="one step of priority is worth so much waiting; missions nearer than half are peers"
    )
    rules_wait_s: Seconds = Field(default=60.0, description="how long a robot may take to obey new area rules")
    failures: FailurePolicies = FailurePolicies()
    approval: tuple[ApprovalRule, ...] = ()


class Event(Message):
    """Something that happened at `at`."""

    at: UnixTime


class Started(Event):
    """The scheduler came up: a new epoch, and nothing is known of robots and objects until they are seen again."""

    kind: Literal["started"] = "started"
    epoch: int = Field(ge=1)
    skills: tuple[Skill, ...] = Field(default=(), description="the site's own, beside the paper's")
    policy: Policy = Policy()


class MissionSubmitted(Event):
    """A person asked for something; `tasks` is None until the planner has planned it. Has passed the gate."""

    kind: Literal["mission_submitted"] = "mission_submitted"
    mission_id: Id
    text: InstructionText
    tasks: tuple[PlanTask, ...] | None = None
    priority: Priority = 5
    approval: Approval = "auto"
    idempotency_key: str | None = None
    ask_because: tuple[str, ...] = Field(default=(), description="why the site's rules want a person to see the plan")


class MissionControlled(Event):
    """Someone acts on a mission; a plan in it has passed the gate."""

    kind: Literal["mission_controlled"] = "mission_controlled"
    control: ControlMission
    ask_because: tuple[str, ...] = Field(default=(), description="why the site's rules want a person to see its plan")


class MissionReplanned(Event):
    """The planner's answer about a task that failed: a new plan for the rest, which has passed the gate, or none."""

    kind: Literal["mission_replanned"] = "mission_replanned"
    mission_id: Id
    task_id: Id
    number: int = Field(ge=1)
    tasks: tuple[PlanTask, ...] | None = None
    reasons: tuple[Reason, ...] = ()
    ask_because: tuple[str, ...] = ()


class MissionsArchived(Event):
    """Missions that ended long ago leave the state; the store has them by now."""

    kind: Literal["missions_archived"] = "missions_archived"
    mission_ids: Annotated[tuple[Id, ...], Field(min_length=1)]


class RobotOnline(Event):
    """A robot's agent is there, perhaps in a new life."""

    kind: Literal["robot_online"] = "robot_online"
    card: RobotCard


class RobotOffline(Event):
    """A robot is lost: nothing new is dispatched to it, and what it was doing is unknown."""

    kind: Literal["robot_offline"] = "robot_offline"
    robot_id: Id
    reason: str = Field(max_length=200)


class RulesObeyed(Event):
    """A robot's own state says that it obeys the area rules up to `revision`."""

    kind: Literal["rules_obeyed"] = "rules_obeyed"
    robot_id: Id
    revision: int = Field(ge=0)


class ObjectsChanged(Event):
    """Names that came into the object map, and names that left it."""

    kind: Literal["objects_changed"] = "objects_changed"
    appeared: tuple[Id, ...] = ()
    gone: tuple[Id, ...] = ()


class StatusReceived(Event):
    """An agent's word on an attempt."""

    kind: Literal["status_received"] = "status_received"
    status: SkillStatus


class StopOrdered(Event):
    """Someone stops or releases one robot, or all."""

    kind: Literal["stop_ordered"] = "stop_ordered"
    robot_id: Id | None = None
    stop: bool


class StopObeyed(Event):
    """An agent's word that it has obeyed the newest stop order."""

    kind: Literal["stop_obeyed"] = "stop_obeyed"
    status: StopStatus


class Tick(Event):
    """A deadline of the core's has come."""

    kind: Literal["tick"] = "tick"


class SelectorBound(Event):
    """Decision: these robots are what the mission's selector means, for the rest of the mission."""

    kind: Literal["selector_bound"] = "selector_bound"
    mission_id: Id
    selector: str = Field(max_length=8192)
    robots: Annotated[tuple[Id, ...], Field(min_length=1)]


class Order(Message):
    """One robot's part in an attempt."""

    robot_id: Id
    boot_id: Id
    goals: tuple[Pose, ...] = ()
    partner: Id | None = None


class TaskDispatched(Event):
    """Decision: the task's robots begin attempt `attempt` together."""

    kind: Literal["task_dispatched"] = "task_dispatched"
    mission_id: Id
    task_id: Id
    attempt: int = Field(ge=1)
    orders: Annotated[tuple[Order, ...], Field(min_length=1)]
    objects: tuple[TargetObject, ...] = ()
    rules_added: tuple[AreaRule, ...] = ()
    rules_removed: tuple[tuple[Id, Id], ...] = Field(default=(), description="(robot, object)")


class TaskBlocked(Event):
    """Decision: everything is there but a place to stand; tried again until the deadline."""

    kind: Literal["task_blocked"] = "task_blocked"
    mission_id: Id
    task_id: Id
    waiting_for: str = Field(max_length=400)


class TaskDeferred(Event):
    """Decision: its free robots are kept for what is more urgent or saves more time; looked at again then."""

    kind: Literal["task_deferred"] = "task_deferred"
    mission_id: Id
    task_id: Id
    until: UnixTime
    waiting_for: str = Field(max_length=400)


class TaskImpossible(Event):
    """Decision: the task cannot be done, such as driving to where the robot must not go."""

    kind: Literal["task_impossible"] = "task_impossible"
    mission_id: Id
    task_id: Id
    reason: str = Field(max_length=1000)


AnyEvent = Annotated[
    Started
    | MissionSubmitted
    | MissionControlled
    | MissionsArchived
    | MissionReplanned
    | RobotOnline
    | RobotOffline
    | RulesObeyed
    | ObjectsChanged
    | StatusReceived
    | StopOrdered
    | StopObeyed
    | Tick
    | SelectorBound
    | TaskDispatched
    | TaskBlocked
    | TaskDeferred
    | TaskImpossible,
    Field(discriminator="kind"),
]

EVENT: TypeAdapter[AnyEvent] = TypeAdapter(AnyEvent)
"""Reads an event back from the journal's JSON."""
