"""Instructions in, missions out, and what a person may do about a mission."""

from typing import Annotated

from fastapi import APIRouter, Header, Path, Query, Request
from muster_schemas.ids import Id, new_id
from muster_schemas.mission import MissionStatus, MissionView
from muster_schemas.plan import Plan
from muster_schemas.rpc import ControlReply, MissionAction, SubmitMission
from starlette.responses import JSONResponse, Response

from muster_planner.drafting import Outcome
from muster_planner.errors import SetupError
from muster_planner.instructions import clean_instruction
from muster_planner.pipeline import QueueFullError
from muster_planner.published import published_form

from .parts import parts_of
from .problems import ProblemError, documented
from .views import Accepted, Controlled, DryRun, Instruction, MissionDetails, Missions

router = APIRouter(tags=["missions"])

MissionId = Annotated[Id, Path(description="as `POST /instructions` answered it")]
PlanRevision = Annotated[
    int | None,
    Query(ge=0, description="`plan_revision` of the mission as it was read; refused (409) if the plan changed since"),
]
IdempotencyKey = Annotated[
    str | None,
    Header(
        min_length=1,
        max_length=128,
        pattern=r"^[!-~]+$",
        description="the same key again returns the mission that the first request made",
    ),
]


@router.post(
    "/instructions",
    summary="Send an instruction",
    status_code=202,
    response_model=Accepted,
    responses={200: {"model": DryRun, "description": "the plan of a dry run"}, **documented(400, 401, 413, 422, 503)},
)
async def post_instruction(
    request: Request, instruction: Instruction, idempotency_key: IdempotencyKey = None
) -> Response:
    """Make a mission of the instruction; it is planned at once and, unless `approval` is `ask`, carried out.

    With `dry_run` the plan comes back and nothing is made. An instruction that cannot be planned becomes a mission that
    is `rejected` with its reasons (a dry run answers 422 with them).
    """
    parts = parts_of(request)
    text = clean_instruction(instruction.text)
    if instruction.dry_run:
        outcome = await parts.pipeline.dry_run(text, instruction.priority)
        return JSONResponse({"plan": published_form(outcome.plan)}) if outcome.plan else _no_plan(outcome)
    if parts.pipeline.full:
        raise QueueFullError
    reply = await parts.scheduler.submit(
        SubmitMission(
            text=text,
            priority=instruction.priority,
            approval=instruction.approval,
            idempotency_key=idempotency_key or new_id("once"),
        )
    )
    if idempotency_key is not None:
        await _check_same_text(await parts.scheduler.mission(reply.mission_id), text)
    if reply.state is MissionStatus.PLANNING:
        await parts.pipeline.add_by_id(reply.mission_id)
    return JSONResponse(Accepted.of(reply).model_dump(mode="json"), status_code=202)


@router.get("/missions", summary="List missions", responses=documented(401, 422, 503))
async def get_missions(
    request: Request,
    state: Annotated[list[MissionStatus], Query(description="only these; repeatable")] = [],  # noqa: B006 (FastAPI copies)
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> Missions:
    """Return the newest missions with their plans and tasks."""
    views = await parts_of(request).scheduler.missions(tuple(state), limit)
    return Missions(missions=[MissionDetails.of(v) for v in views])


@router.get("/missions/{mission_id}", summary="Read a mission", responses=documented(401, 404, 422, 503))
async def get_mission(request: Request, mission_id: MissionId) -> MissionDetails:
    """Return a mission with its plan, and each task with what it waits for."""
    return MissionDetails.of(await _found(request, mission_id))


@router.put(
    "/missions/{mission_id}/plan", summary="Edit a plan", responses=documented(400, 401, 404, 409, 413, 422, 503)
)
async def put_plan(
    request: Request, mission_id: MissionId, plan: Plan, plan_revision: PlanRevision = None
) -> Controlled:
    """Replace the plan of a mission that awaits approval; the new one must pass the same gate.

    In a running mission whose new plan for the rest awaits approval, it is that one that is replaced.
    """
    view = await _found(request, mission_id)
    mission = view.mission
    if mission.state is not MissionStatus.AWAITING_APPROVAL and not view.proposals:
        detail = f"The mission is {mission.state}; only a plan that awaits approval can be edited."
        raise ProblemError(409, "conflict", detail)
    return Controlled.of(await parts_of(request).scheduler.set_plan(mission_id, plan, plan_revision))


_ACTION = documented(401, 404, 409, 422, 503)


@router.post("/missions/{mission_id}/approve", summary="Approve the plan", responses=_ACTION)
async def approve(request: Request, mission_id: MissionId, plan_revision: PlanRevision = None) -> Controlled:
    """Let a mission that awaits approval run."""
    reply = await parts_of(request).scheduler.act(mission_id, MissionAction.APPROVE, plan_revision=plan_revision)
    return Controlled.of(reply)


@router.post("/missions/{mission_id}/reject", summary="Reject the plan", responses=_ACTION)
async def reject(request: Request, mission_id: MissionId) -> Controlled:
    """Turn down the plan of a mission that awaits approval."""
    return Controlled.of(await _act(request, mission_id, MissionAction.REJECT))


@router.post("/missions/{mission_id}/cancel", summary="Cancel a mission", responses=_ACTION)
async def cancel(request: Request, mission_id: MissionId) -> Controlled:
    """Stop its robots and end it."""
    return Controlled.of(await _act(request, mission_id, MissionAction.CANCEL))


@router.post("/missions/{mission_id}/pause", summary="Pause a mission", responses=_ACTION)
async def pause(request: Request, mission_id: MissionId) -> Controlled:
    """Hold its robots where they are."""
    return Controlled.of(await _act(request, mission_id, MissionAction.PAUSE))


@router.post("/missions/{mission_id}/resume", summary="Resume a mission", responses=_ACTION)
async def resume(request: Request, mission_id: MissionId) -> Controlled:
    """Let a paused mission go on."""
    return Controlled.of(await _act(request, mission_id, MissionAction.RESUME))


async def _act(request: Request, mission_id: str, action: MissionAction) -> ControlReply:
    return await parts_of(request).scheduler.act(mission_id, action)


async def _found(request: Request, mission_id: str) -> MissionView:
    view = await parts_of(request).scheduler.mission(mission_id)
    if view is None:
        raise ProblemError(404, "not_found", f"There is no mission {mission_id}. GET /missions lists those there are.")
    return view


async def _check_same_text(view: MissionView | None, text: str) -> None:
    if view is not None and view.mission.text != text:
        detail = "This Idempotency-Key was used for another instruction. Take a new key for a new instruction."
        raise ProblemError(422, "key_reused", detail)


def _no_plan(outcome: Outcome) -> Response:
    """Raise why a dry run has no plan: the model's server (503, come back) or the instruction (422)."""
    detail = " ".join(r.message for r in outcome.reasons)[:2000]
    status = 503 if isinstance(outcome.failure, SetupError) else 422
    raise ProblemError(status, outcome.reasons[0].code if outcome.reasons else "no_plan", detail, outcome.reasons)
