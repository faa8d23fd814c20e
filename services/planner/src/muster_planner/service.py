"""Puts the planner together: the model, the view of the site, the pipeline, and the REST API in front."""

import asyncio
import socket
from collections.abc import Generator
from contextlib import contextmanager

import structlog
import uvicorn
from muster_bus import Bus
from muster_schemas.channels import REPLAN
from muster_schemas.site import load_site

from .api.app import create_app
from .api.parts import Parts
from .budget import DailyBudget
from .events import Hub
from .llm import PlanningModel, open_model
from .metrics import Metrics
from .pipeline import Pipeline
from .scheduler import Scheduler
from .settings import PlannerSettings, is_loopback
from .site_view import SiteView

_log = structlog.stdlib.get_logger(__name__)

_CLOSE_S = 5
"""How long open requests get to finish at the end."""


def bind(settings: PlannerSettings) -> socket.socket:
    """Return the socket on which the REST API will listen.

    Raises:
        OSError: the address is taken or is none of this machine's.

    """
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    return socket.create_server((settings.host, settings.port), family=family)


async def serve(bus: Bus, stop: asyncio.Event, settings: PlannerSettings, listening: socket.socket) -> None:
    """Load the model that the settings choose, then plan missions and answer HTTP until `stop` is set."""
    budget = DailyBudget(settings.data_dir / "planner-budget.json", settings.plan_tokens_per_day)
    async with open_model(settings.planner, budget) as model:
        await serve_model(bus, stop, settings, listening, model)


async def serve_model(
    bus: Bus, stop: asyncio.Event, settings: PlannerSettings, listening: socket.socket, model: PlanningModel
) -> None:
    """Plan missions with this model and answer HTTP until `stop` is set."""
    hub, metrics = Hub(), Metrics()
    view = SiteView(bus, load_site(settings.site_file), hub)
    pipeline = Pipeline(bus, model, view, metrics, settings.limits, settings.plan_queue)
    parts = Parts(bus, Scheduler(bus), pipeline, view, hub, metrics, settings.planner)
    token = settings.token.get_secret_value() if settings.token else None
    app = create_app(parts, token=token, loopback=is_loopback(settings.host))
    server = _Server(
        uvicorn.Config(
            app,
            log_config=None,
            access_log=False,
            lifespan="off",
            server_header=False,
            timeout_graceful_shutdown=_CLOSE_S,
        )
    )
    async with asyncio.TaskGroup() as tasks, bus.serve(REPLAN, pipeline.replan):
        working = [tasks.create_task(view.run(), name="view"), tasks.create_task(pipeline.run(), name="pipeline")]
        serving = tasks.create_task(server.serve(sockets=[listening]), name="http")
        _log.info("listening", host=settings.host, port=listening.getsockname()[1], planner=settings.planner)
        await stop.wait()
        server.should_exit = True
        hub.close()
        await serving
        for task in working:
            task.cancel()


class _Server(uvicorn.Server):
    """Leaves signals to the runtime, which ends this service as every other."""

    @contextmanager
    def capture_signals(self) -> Generator[None]:
        """Capture none."""
        yield
