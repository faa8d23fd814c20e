"""Request and reply: the server's side (`Server`) and the asker's (`ask`).

One queryable answers a request: it declares itself complete and the asker wants the best matching one, so a stale
second server does not run a command again. No answer means that nobody knows whether it ran.
"""

# Zenoh's stubs leave return types out.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false, reportUnknownArgumentType=false

import asyncio
from collections.abc import Awaitable, Callable
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

import structlog
import zenoh
from muster_schemas.channels import Channel
from muster_schemas.rpc import ErrorCode, ErrorReply
from pydantic import BaseModel

from .errors import NoReplyError, Refusal, RefusedError
from .inbox import Inbox, InboxClosedError, call_in
from .presence import settled
from .rejects import Rejects
from .wire import JSON, MalformedError, checked_size, encode, parse, size_limit

M = TypeVar("M", bound=BaseModel)
Handler = Callable[[M], Awaitable[BaseModel]]

_log = structlog.stdlib.get_logger(__name__)

_AT_ONCE = 100
"""Requests that one server handles at the same time; more are told to come back."""


class Server(Generic[M]):
    """Answers the requests of a channel while entered; each in its own task."""

    def __init__(
        self, session: zenoh.Session, channel: Channel[M], site: str, handler: Handler[M], rejects: Rejects
    ) -> None:
        if channel.reply is None:
            raise TypeError(f"channel {channel.name} is no request and reply")
        self._session = session
        self._channel = channel
        self._key = channel.key(site=site)
        self._handler = handler
        self._rejects = rejects
        self._running: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> Self:
        self._inbox: Inbox[zenoh.Query] = Inbox(limit=1000)
        inbox = self._inbox

        def enqueue(query: zenoh.Query) -> None:
            inbox.put("", query)

        callback = zenoh.handlers.Callback(enqueue, indirect=False)
        self._queryable = self._session.declare_queryable(self._key, callback, complete=True)
        self._accepting = asyncio.create_task(self._accept(), name=f"serve {self._key}")
        await settled(self._session, self._key)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Take no more requests, and let those that run finish (the caller's own time limit ends that)."""
        self._queryable.undeclare()
        self._inbox.close()
        await self._accepting
        await asyncio.gather(*self._running)

    async def _accept(self) -> None:
        while True:
            try:
                query = await self._inbox.get()
            except InboxClosedError:
                return
            if len(self._running) >= _AT_ONCE:
                _reply_error(query, ErrorReply(code=ErrorCode.UNAVAILABLE, message="Too many requests at once."))
                continue
            task = asyncio.create_task(self._handle(query), name=f"handle {self._key}")
            self._running.add(task)
            task.add_done_callback(self._running.discard)

    async def _handle(self, query: zenoh.Query) -> None:
        try:
            request = self._request(query)
            reply = await self._handler(request)
            payload = self._encode(reply)
        except Refusal as refusal:
            _reply_error(query, refusal.error)
        except asyncio.CancelledError:
            query.drop()
            raise
        except Exception:  # noqa: BLE001  (logged and answered; one bad request must not end the service)
            _log.exception("request_failed", channel=self._channel.name)
            error = ErrorReply(code=ErrorCode.INTERNAL, message=f"{self._channel.owner} failed; its log says why.")
            _reply_error(query, error)
        else:
            _answer(query, lambda: query.reply(self._key, payload, encoding=JSON))

    def _request(self, query: zenoh.Query) -> M:
        """Return the request, or raise the refusal of one that is malformed."""
        payload = query.payload
        try:
            if payload is None:
                raise MalformedError("has no payload")
            if len(payload) > size_limit(self._channel):
                raise MalformedError(f"has {len(payload)} bytes, more than {size_limit(self._channel)}")
            if query.encoding != JSON:
                raise MalformedError(f"has the encoding {str(query.encoding)[:60]!r}, not {JSON}")
            return parse(self._channel.model, payload.to_bytes())
        except MalformedError as error:
            self._rejects.count(self._channel.name, str(query.key_expr), str(error))
            raise Refusal.because(ErrorCode.INVALID, f"The request {error}.") from error

    def _encode(self, reply: BaseModel) -> bytes:
        wanted = self._channel.reply
        if wanted is None or not isinstance(reply, wanted):
            raise TypeError(f"the handler of {self._channel.name} returned a {type(reply).__name__}")
        payload = reply.model_dump_json(by_alias=True).encode()
        if len(payload) > size_limit(self._channel):
            raise Refusal.because(ErrorCode.INVALID, "The reply would be too large; ask for less.")
        return payload


def _reply_error(query: zenoh.Query, error: ErrorReply) -> None:
    _answer(query, lambda: query.reply_err(error.to_json(), encoding=JSON))


def _answer(query: zenoh.Query, send: Callable[[], None]) -> None:
    try:
        send()
    except zenoh.ZError as error:  # the asker or our link has gone
        _log.info("reply_not_sent", error=str(error)[:200])
    finally:
        query.drop()


async def ask(
    session: zenoh.Session, channel: Channel[Any], site: str, request: BaseModel, rejects: Rejects, timeout_s: float
) -> BaseModel:
    """Send a request and return its reply; see `Bus.ask`."""
    model = channel.reply
    if model is None:
        raise TypeError(f"channel {channel.name} is no request and reply")
    payload = encode(channel, request, {})
    try:
        reply = await _one_reply(session, channel.key(site=site), payload, timeout_s)
    except zenoh.ZError as error:
        raise NoReplyError(f"{channel.name} could not be asked: {str(error)[:200]}") from error
    if reply is None:
        raise NoReplyError(f"nobody answered {channel.name}; is the {channel.owner} running?")
    if reply.ok is not None:
        try:
            return parse(model, checked_size(channel, reply.ok.payload.to_bytes()))
        except (MalformedError, ValueError) as error:
            rejects.count(channel.name, "reply", str(error))
            raise NoReplyError(f"the reply to {channel.name} makes no sense: {error}") from error
    assert reply.err is not None  # noqa: S101  (a reply is one or the other)
    try:
        refused = parse(ErrorReply, reply.err.payload.to_bytes())
    except MalformedError as error:
        # Zenoh itself reports a timeout as an error with a plain text.
        raise NoReplyError(f"{channel.owner} did not answer {channel.name} within {timeout_s:g} s") from error
    raise RefusedError(refused)


async def _one_reply(session: zenoh.Session, key: str, payload: bytes, timeout_s: float) -> zenoh.Reply | None:
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()
    replies: list[zenoh.Reply] = []
    cancel = zenoh.CancellationToken()

    def finish() -> None:
        if not done.done():
            done.set_result(None)

    def on_end() -> None:
        call_in(loop, finish)

    session.get(
        key,
        zenoh.handlers.Callback(replies.append, drop=on_end, indirect=False),
        target=zenoh.QueryTarget.BEST_MATCHING,
        consolidation=zenoh.ConsolidationMode.NONE,
        congestion_control=zenoh.CongestionControl.BLOCK,
        priority=zenoh.Priority.INTERACTIVE_LOW,
        timeout=timeout_s,
        payload=payload,
        encoding=JSON,
        cancellation_token=cancel,
    )
    try:
        await done
    except asyncio.CancelledError:
        cancel.cancel()
        raise
    return next((r for r in replies if r.ok is not None), replies[0] if replies else None)
