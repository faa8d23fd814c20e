"""What stands before every route: size of the body, whose page asks, and the operators' token."""

import secrets
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .problems import problem

MAX_BODY_BYTES: Final = 64 * 1024

_READ_ON_BYTES: Final = 16 * 2**20

OPEN_PATHS: Final = frozenset({"/healthz", "/readyz", "/docs", "/openapi.json"})
"""Without a token: probes have none, and the description of the API is no secret."""

_LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "::1"})


class BodyLimit:
    """Answers 413 to a body of more than `MAX_BODY_BYTES`, without keeping more than that of it."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what is small enough."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        try:
            body = await _read(receive)
        except _ClientGoneError:
            return
        if body is None:
            detail = f"The body is larger than {MAX_BODY_BYTES} bytes. Send less."
            await problem(413, "too_large", detail, headers={"Connection": "close"})(scope, receive, send)
            return
        whole: Message | None = {"type": "http.request", "body": body, "more_body": False}

        async def replay() -> Message:
            nonlocal whole
            if whole is None:
                return await receive()
            message, whole = whole, None
            return message

        await self._app(scope, replay, send)


class _ClientGoneError(Exception):
    """The connection ended before the body did."""


async def _read(receive: Receive) -> bytes | None:
    """Return the whole body (no route needs it as a stream), or None if it is too large.

    What is too large is read on for a while and thrown away, because a client that is still sending when the
    connection is closed does not get to read why.
    """
    body, size = bytearray(), 0
    while True:
        message = await receive()
        if message["type"] != "http.request":
            raise _ClientGoneError
        piece: bytes = message.get("body", b"")
        size += len(piece)
        if size <= MAX_BODY_BYTES:
            body += piece
        if not message.get("more_body", False) or size > _READ_ON_BYTES:
            return bytes(body) if size <= MAX_BODY_BYTES else None


class Guard:
    """Answers 401 to a request without the token, and 403 to one that another site's page makes in a browser."""

    def __init__(self, app: ASGIApp, *, token: str | None, loopback: bool) -> None:
        self._app = app
        self._token = token.encode() if token is not None else None
        self._loopback = loopback

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what is allowed."""
        if scope["type"] == "http":
            headers = Headers(scope=scope)
            if self._foreign(headers):
                detail = (
                    "The request comes from another site's page, or to another host's name. Ask the planner itself."
                )
                await problem(403, "foreign_origin", detail)(scope, receive, send)
                return
            if scope["path"] not in OPEN_PATHS and not self._knows_token(headers):
                detail = "Send the header `Authorization: Bearer TOKEN` with the token that MUSTER_TOKEN holds."
                answer = problem(401, "unauthorized", detail, headers={"WWW-Authenticate": "Bearer"})
                await answer(scope, receive, send)
                return
        await self._app(scope, receive, send)

    def _knows_token(self, headers: Headers) -> bool:
        if self._token is None:
            return True
        kind, _, given = headers.get("authorization", "").partition(" ")
        # compared as bytes and in constant time: how far a guess is right must not show
        return kind.lower() == "bearer" and secrets.compare_digest(given.strip().encode("latin-1"), self._token)

    def _foreign(self, headers: Headers) -> bool:
        """Return whether a browser sends this for another site's page (or for a name that was pointed at us)."""
        host, origin = headers.get("host", ""), headers.get("origin")
        try:
            name = urlsplit(f"//{host}").hostname or ""
            elsewhere = origin is not None and urlsplit(origin).netloc != host
        except ValueError:
            return True
        return elsewhere or (self._loopback and bool(host) and name not in _LOOPBACK_NAMES)
