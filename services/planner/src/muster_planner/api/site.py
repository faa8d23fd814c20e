"""What is on the site now, and what changes."""

from collections.abc import AsyncGenerator

from fastapi import APIRouter, Request
from muster_schemas.world import AreaRules
from sse_starlette import EventSourceResponse, ServerSentEvent

from muster_planner.events import MAX_LISTENERS, Hub, TooManyListenersError

from .parts import parts_of
from .problems import documented
from .views import Fleet, Objects

router = APIRouter(tags=["site"])


@router.get("/fleet", summary="The robots", responses=documented(401))
async def get_fleet(request: Request) -> Fleet:
    """Return every robot's card, whether it is there, and its last state."""
    return Fleet(robots=parts_of(request).view.fleet)


@router.get("/objects", summary="The object map", responses=documented(401), response_model_by_alias=True)
async def get_objects(request: Request) -> Objects:
    """Return what the cameras see, in metres."""
    return Objects(objects=parts_of(request).view.objects)


@router.get("/areas", summary="The area rules", responses=documented(401))
async def get_areas(request: Request) -> AreaRules:
    """Return which robot keeps out of what."""
    return parts_of(request).view.rules


@router.get(
    "/events",
    summary="Follow changes",
    response_class=EventSourceResponse,
    responses={
        200: {"content": {"text/event-stream": {}}, "description": "server-sent events"},
        **documented(401, 503),
    },
)
async def get_events(request: Request) -> EventSourceResponse:
    """Stream `mission`, `task`, `robot`, `object` and `areas` events, each the JSON of what has changed.

    The stream begins with now: open it, then read `/missions` and `/fleet`, and keep what has the higher `revision`.
    A listener that falls far behind is cut off, and does the same again.
    """
    hub = parts_of(request).hub
    if hub.listeners >= MAX_LISTENERS:
        raise TooManyListenersError
    return EventSourceResponse(_stream(hub), ping=15)


async def _stream(hub: Hub) -> AsyncGenerator[ServerSentEvent]:
    with hub.listen() as listener:
        async for event in listener.read():
            yield ServerSentEvent(data=event.data, event=event.kind)
