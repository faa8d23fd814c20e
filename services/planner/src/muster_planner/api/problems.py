"""Errors over HTTP: RFC 9457 problem details, each with a `detail` that tells what to do.

400 broken JSON      401 no token     403 another site's page    404 no such thing     405 not that way
409 cannot be now    413 too large    422 breaks a rule          503 come back later (Retry-After)
"""

from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any, Final

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from muster_bus import NoReplyError, RefusedError
from muster_schemas.mission import Reason
from muster_schemas.rpc import ErrorCode
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse, Response

from muster_planner.events import TooManyListenersError
from muster_planner.instructions import InstructionError
from muster_planner.pipeline import QueueFullError

MEDIA_TYPE: Final = "application/problem+json"
RETRY_AFTER_S: Final = 2

_STATUS_OF: Final = {
    ErrorCode.INVALID: 422,
    ErrorCode.NOT_FOUND: 404,
    ErrorCode.CONFLICT: 409,
    ErrorCode.UNAVAILABLE: 503,
    ErrorCode.INTERNAL: 500,
}
_MAX_FIELDS: Final = 20


class FieldProblem(BaseModel):
    """What is wrong with one field of a request."""

    field: str
    message: str


class ProblemDetails(BaseModel):
    """RFC 9457, with `code` for programs, `reasons` against a plan, and `fields` of a request that breaks a rule."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    code: str
    reasons: list[Reason] = Field(default_factory=list[Reason])
    fields: list[FieldProblem] = Field(default_factory=list[FieldProblem])


class ProblemError(Exception):
    """Raised by a route to answer with a problem."""

    def __init__(self, status: int, code: str, detail: str, reasons: Sequence[Reason] = ()) -> None:
        super().__init__(detail)
        self.status = status
        self.code = code
        self.detail = detail
        self.reasons = reasons


def problem(
    status: int,
    code: str,
    detail: str,
    *,
    reasons: Sequence[Reason] = (),
    fields: Sequence[FieldProblem] = (),
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Return the answer to a request that cannot be done."""
    body = ProblemDetails(
        title=HTTPStatus(status).phrase,
        status=status,
        detail=detail,
        code=code,
        reasons=list(reasons),
        fields=list(fields),
    )
    extra = {"Retry-After": str(RETRY_AFTER_S)} if status == 503 else {}
    return JSONResponse(body.model_dump(mode="json"), status, {**extra, **(headers or {})}, MEDIA_TYPE)


def documented(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return what OpenAPI says of these answers."""
    return {
        status: {
            "description": HTTPStatus(status).phrase,
            "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/ProblemDetails"}}},
        }
        for status in statuses
    }


def add_handlers(app: FastAPI) -> None:
    """Have every error of a route answered with a problem."""
    app.add_exception_handler(ProblemError, _on_problem)
    app.add_exception_handler(RequestValidationError, _on_invalid)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(InstructionError, _on_instruction)
    app.add_exception_handler(RefusedError, _on_refused)
    app.add_exception_handler(NoReplyError, _on_silence)
    app.add_exception_handler(QueueFullError, _on_full)
    app.add_exception_handler(TooManyListenersError, _on_full)
    app.add_exception_handler(Exception, _on_fault)


async def _on_problem(_request: Request, error: Exception) -> Response:
    assert isinstance(error, ProblemError)  # noqa: S101 (registered for this type)
    return problem(error.status, error.code, error.detail, reasons=error.reasons)


async def _on_invalid(_request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)  # noqa: S101 (registered for this type)
    found: Sequence[Any] = error.errors()
    if any(e["type"] == "json_invalid" for e in found):
        return problem(400, "broken_json", "The body is not JSON. Send UTF-8 JSON as application/json.")
    fields = [FieldProblem(field=_printable(".".join(map(str, e["loc"]))), message=_printable(e["msg"])) for e in found]
    first = "; ".join(f"{f.field}: {f.message}" for f in fields[:3])
    return problem(422, "invalid_request", f"The request breaks a rule. {first}."[:1000], fields=fields[:_MAX_FIELDS])


async def _on_http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)  # noqa: S101 (registered for this type)
    details = {
        400: "The body is not JSON that can be read. Send UTF-8 JSON as application/json, not deeply nested.",
        404: "There is nothing at this address. The calls are listed at /docs.",
        405: f"{_printable(request.method)} is not possible here. The calls are listed at /docs.",
    }
    codes = {400: "broken_json", 404: "no_such_address", 405: "wrong_method"}
    detail = details.get(error.status_code, _printable(str(error.detail)))
    return problem(error.status_code, codes.get(error.status_code, "error"), detail, headers=error.headers)


async def _on_instruction(_request: Request, error: Exception) -> Response:
    field = FieldProblem(field="body.text", message=str(error))
    return problem(422, "no_instruction", str(error), fields=[field])


async def _on_refused(_request: Request, error: Exception) -> Response:
    assert isinstance(error, RefusedError)  # noqa: S101 (registered for this type)
    reply = error.error
    return problem(_STATUS_OF[reply.code], reply.code, reply.message, reasons=reply.reasons)


async def _on_silence(_request: Request, _error: Exception) -> Response:
    detail = (
        "The scheduler does not answer, so it is not known whether this was done. Send it again; an instruction with "
        "the same Idempotency-Key, so that it is not done twice."
    )
    return problem(503, "scheduler_silent", detail)


async def _on_full(_request: Request, _error: Exception) -> Response:
    return problem(503, "busy", "As many requests wait as may. Nothing was done; send it again in a moment.")


async def _on_fault(_request: Request, _error: Exception) -> Response:
    return problem(500, "fault", "The planner failed at this request; its log says why.")


def _printable(text: str) -> str:
    """Return the text as something that UTF-8 can hold: a request may hold halves of characters."""
    return text.encode("utf-8", errors="replace").decode("utf-8")[:500]
