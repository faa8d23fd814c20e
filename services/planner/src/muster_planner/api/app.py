"""The REST API as one ASGI app."""

from importlib.metadata import version
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from muster_planner.metrics import Metrics

from . import control, missions, operations, site
from .parts import Parts
from .problems import ProblemDetails, add_handlers
from .security import OPEN_PATHS, BodyLimit, Guard

_ABOUT = (
    "Instructions in, missions out. Errors are problem details (RFC 9457, application/problem+json) that say what to "
    "do. If the planner was started with a token, each call needs `Authorization: Bearer TOKEN`."
)


def create_app(parts: Parts, *, token: str | None, loopback: bool) -> FastAPI:
    """Return the app.

    Args:
        parts: the running planner.
        token: what operators must send; None: nothing.
        loopback: whether only this machine can reach it, so that only its own names are asked for.

    """
    app = FastAPI(
        title="Muster planner", version=version("muster-planner"), description=_ABOUT, docs_url=None, redoc_url=None
    )
    app.state.parts = parts
    for router in (missions.router, control.router, site.router, operations.router):
        app.include_router(router)
    add_handlers(app)
    # the last one added is the first that a request meets
    app.add_middleware(BodyLimit)
    app.add_middleware(Guard, token=token, loopback=loopback)
    app.add_middleware(CountRequests, metrics=parts.metrics)

    def describe() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _describe(app, with_token=token is not None)
        return app.openapi_schema

    app.openapi = describe
    return app


class CountRequests:
    """Counts answers by route and status (by the route's pattern, so that ids do not make new rows)."""

    def __init__(self, app: ASGIApp, *, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on and note how it was answered."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def note(message: Message) -> None:
            if message["type"] == "http.response.start":
                route = getattr(scope.get("route"), "path", "none")
                method = scope["method"] if scope["method"] in _METHODS else "other"
                self._metrics.requests.labels(method, route, str(message["status"])).inc()
            await send(message)

        await self._app(scope, receive, note)


_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS"})


def _describe(app: FastAPI, *, with_token: bool) -> dict[str, Any]:
    """Return the OpenAPI description, with the error model and the token that FastAPI does not know of."""
    described = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
    components = described.setdefault("components", {})
    schemas = components.setdefault("schemas", {})
    errors = ProblemDetails.model_json_schema(ref_template="#/components/schemas/{model}")
    schemas.update(errors.pop("$defs"))
    schemas["ProblemDetails"] = errors
    schemas.pop("HTTPValidationError", None)
    schemas.pop("ValidationError", None)
    if with_token:
        components["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        for path, methods in described["paths"].items():
            for call in methods.values():
                if path not in OPEN_PATHS:
                    call["security"] = [{"token": []}]
    return described
