"""What the REST API takes and shows; the bus has its own models (`muster_schemas`), which these follow."""

from typing import Any, Self

from muster_schemas.ids import Id
from muster_schemas.mission import MAX_TEXT, Approval, MissionStatus, MissionView, Priority, Reason, TaskState
from muster_schemas.rpc import ControlReply
from muster_schemas.world import MapObject
from pydantic import BaseModel, ConfigDict, Field

from muster_planner.published import published_form
from muster_planner.site_view import FleetRobot

_RAW_TEXT = 4 * MAX_TEXT
"""Characters before control characters and doubled spaces are taken out."""


class Instruction(BaseModel):
    """One sentence (or some) of an operator."""

    model_config = ConfigDict(
        strict=True,
        extra="forbid",
        json_schema_extra={"examples": [{"text": "Excavator 1, dig at the first soil pile."}]},
    )

    text: str = Field(min_length=1, max_length=_RAW_TEXT, description=f"at most {MAX_TEXT} characters once cleaned")
    priority: Priority = Field(default=5, description="9 is the most urgent")
    approval: Approval = Field(default="auto", description="ask: the plan waits for a person's approval")
    dry_run: bool = Field(default=False, description="only plan; no mission is made")


class Accepted(BaseModel):
    """A mission, and where it stands now."""

    mission_id: Id
    state: MissionStatus

    @classmethod
    def of(cls, reply: ControlReply) -> Self:
        """Return the REST form of the scheduler's reply."""
        return cls(mission_id=reply.mission_id, state=reply.state)


class Controlled(Accepted):
    """After an action; `robots` says per robot what is known, such as 'stopped' or 'no answer yet'."""

    robots: dict[str, str]

    @classmethod
    def of(cls, reply: ControlReply) -> Self:
        """Return the REST form of the scheduler's reply."""
        return cls(mission_id=reply.mission_id, state=reply.state, robots=dict(reply.robots))


class DryRun(BaseModel):
    """The plan that the instruction would get now, in the published form."""

    plan: dict[str, Any]


class TaskView(BaseModel):
    """One task; times are seconds since 1970."""

    task_id: str
    name: str
    skill: str
    state: str
    robots: list[str]
    objects: list[str]
    dependencies: list[str]
    waiting_for: list[str]
    attempts: int
    progress: float
    error: str | None
    ready_at: float | None
    started_at: float | None
    ended_at: float | None

    @classmethod
    def of(cls, task: TaskState) -> Self:
        """Return the REST form of a task."""
        return cls(
            attempts=task.attempt, **task.model_dump(mode="json", include=cls.model_fields.keys() - {"attempts"})
        )


class MissionDetails(BaseModel):
    """One mission with its plan and tasks; times are seconds since 1970."""

    mission_id: str
    revision: int
    state: MissionStatus
    text: str
    priority: int
    approval: Approval
    reasons: list[Reason] = Field(description="why it waits for approval, was rejected, or failed")
    plan_revision: int = Field(description="of its plan, for an edit")
    created_at: float
    started_at: float | None
    ended_at: float | None
    plan: dict[str, Any] | None
    proposals: dict[str, dict[str, Any]] = Field(
        description="new plans for the rest that await approval, by the task that failed"
    )
    tasks: list[TaskView]

    @classmethod
    def of(cls, view: MissionView) -> Self:
        """Return the REST form of a mission."""
        return cls(
            **view.mission.model_dump(),
            plan=published_form(view.plan) if view.plan else None,
            proposals={task_id: published_form(plan) for task_id, plan in view.proposals.items()},
            tasks=[TaskView.of(t) for t in view.tasks],
        )


class Missions(BaseModel):
    """Newest first."""

    missions: list[MissionDetails]


class Fleet(BaseModel):
    """Every robot that was seen since the planner started."""

    robots: list[FleetRobot]


class Objects(BaseModel):
    """What the cameras see."""

    objects: list[MapObject]


class Health(BaseModel):
    """The process answers."""

    status: str = "ok"


class Readiness(BaseModel):
    """Everything that an instruction needs is there."""

    status: str = "ready"
    planner: str
    waiting: int = Field(description="instructions that wait for their plan or are planned now")
