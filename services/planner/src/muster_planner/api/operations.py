"""For those who run the planner: is it alive, can it work, what has it counted; and the page that lists the calls."""

from fastapi import APIRouter, Request
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from starlette.responses import HTMLResponse, Response

from .docs_page import docs_page
from .parts import parts_of
from .problems import ProblemError, documented
from .views import Health, Readiness

router = APIRouter(tags=["operations"])


@router.get("/healthz", summary="Is it alive?")
async def get_health() -> Health:
    """Return 200 as long as the process answers."""
    return Health()


@router.get("/readyz", summary="Can it work?", responses=documented(503))
async def get_readiness(request: Request) -> Readiness:
    """Return 200 when the bus and the scheduler are there and there is room for an instruction."""
    parts = parts_of(request)
    if not parts.bus.connected:
        raise ProblemError(503, "no_router", "The link to the router is down. Start it, or look at MUSTER_CONNECT.")
    if not parts.view.is_alive("scheduler"):
        raise ProblemError(503, "no_scheduler", "There is no scheduler on the bus. Start it.")
    if parts.pipeline.full:
        raise ProblemError(503, "busy", "As many instructions wait as may. Come back in a moment.")
    return Readiness(planner=parts.planner, waiting=parts.pipeline.waiting)


@router.get(
    "/metrics",
    summary="Numbers for Prometheus",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}, **documented(401)},
)
async def get_metrics(request: Request) -> Response:
    """Return what the planner has counted."""
    return Response(generate_latest(parts_of(request).metrics.registry), media_type=CONTENT_TYPE_LATEST)


@router.get("/docs", include_in_schema=False)
async def get_docs(request: Request) -> HTMLResponse:
    """Return the page that lists every call; it needs nothing from elsewhere."""
    return HTMLResponse(docs_page(request.app.openapi()))
