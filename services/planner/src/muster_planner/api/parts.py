"""What the routes work with, made by the service and hung onto the app."""

from dataclasses import dataclass
from typing import cast

from fastapi import Request
from muster_bus import Bus

from muster_planner.events import Hub
from muster_planner.metrics import Metrics
from muster_planner.pipeline import Pipeline
from muster_planner.scheduler import Scheduler
from muster_planner.site_view import SiteView


@dataclass(frozen=True)
class Parts:
    """The running planner."""

    bus: Bus
    scheduler: Scheduler
    pipeline: Pipeline
    view: SiteView
    hub: Hub
    metrics: Metrics
    planner: str
    """The model that was chosen, as `MUSTER_PLANNER` says it."""


def parts_of(request: Request) -> Parts:
    """Return the running planner of a request's app."""
    return cast("Parts", request.app.state.parts)
