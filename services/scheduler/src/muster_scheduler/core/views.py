"""Missions and tasks as others see them."""

from muster_schemas.mission import MissionState, MissionView, TaskState
from muster_schemas.plan import MAX_TASKS, Plan
from muster_schemas.robot import SkillStatusKind

from .state import Mission, Task


def task_state(task: Task) -> TaskState:
    """Return what is published of a task."""
    runs = task.runs.values()
    return TaskState(
        mission_id=task.mission_id,
        task_id=task.task_id,
        revision=task.revision,
        name=task.name,
        skill=task.skill.name,
        state=task.state,
        robots=task.robots,
        objects=task.objects,
        dependencies=task.dependencies,
        waiting_for=task.waiting_for,
        attempt=task.attempt,
        progress=min((1.0 if r.state is SkillStatusKind.SUCCEEDED else r.progress for r in runs), default=0.0),
        error=task.error,
        ready_at=task.ready_at,
        started_at=task.started_at,
        ended_at=task.ended_at,
    )


def mission_state(mission: Mission) -> MissionState:
    """Return what is published of a mission."""
    return MissionState(
        mission_id=mission.mission_id,
        revision=mission.revision,
        text=mission.text,
        state=mission.state,
        priority=mission.priority,
        approval=mission.approval,
        reasons=mission.reasons,
        plan_revision=mission.plan_revision,
        created_at=mission.created_at,
        started_at=mission.started_at,
        ended_at=mission.ended_at,
    )


def mission_view(mission: Mission) -> MissionView:
    """Return a mission with its plan and tasks. A plan of more tasks than plans may have is left out."""
    tasks = mission.plan
    plan = Plan(tasks=tasks) if tasks is not None and len(tasks) <= MAX_TASKS else None
    return MissionView(
        mission=mission_state(mission),
        plan=plan,
        proposals={t.task_id: Plan(tasks=t.proposal) for t in mission.tasks.values() if t.proposal is not None},
        tasks=tuple(task_state(t) for t in mission.tasks.values()),
    )
