"""What a person may do to robots, and about tasks that failed."""

from typing import Annotated

from fastapi import APIRouter, Path, Request
from muster_schemas.ids import Id
from muster_schemas.rpc import MissionAction
from muster_schemas.stops import StopReply

from .missions import MissionId
from .parts import parts_of
from .problems import documented
from .views import Controlled

router = APIRouter(tags=["control"])

RobotId = Annotated[Id, Path(description="as `GET /fleet` lists it")]
TaskId = Annotated[Id, Path(description="of the task that failed and waits for a decision")]

_STOP = documented(401, 404, 409, 422, 503)


@router.post("/stop", summary="Stop everything", responses=_STOP)
async def stop_all(request: Request) -> StopReply:
    """Have every robot stand still, also those yet to come, until `POST /release`.

    Work is held, not ended. The answer says per robot what is known; send it again to read on.
    """
    return await parts_of(request).scheduler.stop(None, stop=True)


@router.post("/release", summary="Release everything", responses=_STOP)
async def release_all(request: Request) -> StopReply:
    """End the stop of the site. A robot that was stopped by itself stays stopped."""
    return await parts_of(request).scheduler.stop(None, stop=False)


@router.post("/robots/{robot_id}/stop", summary="Stop a robot", responses=_STOP)
async def stop_robot(request: Request, robot_id: RobotId) -> StopReply:
    """Have one robot stand still until it is released, whatever it does now; an idle one starts nothing."""
    return await parts_of(request).scheduler.stop(robot_id, stop=True)


@router.post("/robots/{robot_id}/release", summary="Release a robot", responses=_STOP)
async def release_robot(request: Request, robot_id: RobotId) -> StopReply:
    """Let a stopped robot go on with what it was at."""
    return await parts_of(request).scheduler.stop(robot_id, stop=False)


@router.post("/missions/{mission_id}/tasks/{task_id}/retry", summary="Try a failed task again", responses=_STOP)
async def retry(request: Request, mission_id: MissionId, task_id: TaskId) -> Controlled:
    """Have a task that waits for a decision done once more."""
    return await _decide(request, mission_id, task_id, MissionAction.RETRY)


@router.post("/missions/{mission_id}/tasks/{task_id}/skip", summary="Go on without a failed task", responses=_STOP)
async def skip(request: Request, mission_id: MissionId, task_id: TaskId) -> Controlled:
    """Leave a task out that waits for a decision; what depends on it goes on."""
    return await _decide(request, mission_id, task_id, MissionAction.SKIP)


@router.post("/missions/{mission_id}/tasks/{task_id}/replan", summary="Plan the rest anew", responses=_STOP)
async def replan(request: Request, mission_id: MissionId, task_id: TaskId) -> Controlled:
    """Have the planner make a new plan for a task that waits for a decision, and for what comes after it."""
    return await _decide(request, mission_id, task_id, MissionAction.REPLAN)


async def _decide(request: Request, mission_id: str, task_id: str, action: MissionAction) -> Controlled:
    return Controlled.of(await parts_of(request).scheduler.act(mission_id, action, task_id))
