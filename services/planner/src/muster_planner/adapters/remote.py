"""What the adapters of remote models share: one chat call becomes a draft, within its time and the site's budget."""

import asyncio
import email.utils
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

from pydantic import SecretStr

from muster_planner.budget import Budget
from muster_planner.errors import AnswerError, ModelBusyError, ModelTimeoutError, SetupError, TruncatedAnswerError
from muster_planner.llm import PlanDraft, PlanRequest, TextAnswer
from muster_planner.prompt_json import answer_schema, messages, parse_answer, strict_schema

Chat = Sequence[Mapping[str, str]]

CHARACTERS_PER_TOKEN: Final = 2.5
"""A low estimate, so that room and budget are not overrun."""


@dataclass(frozen=True)
class Access:
    """Where a model's server is and what opens it; None: the client's own default."""

    url: str | None = None
    key: SecretStr | None = None

    @property
    def secret(self) -> str | None:
        """The key as it must be sent."""
        return self.key.get_secret_value().strip() if self.key else None


@dataclass(frozen=True)
class Reply:
    """What a server answered."""

    text: str
    tokens_in: int
    tokens_out: int
    cut: bool = False
    """It reached the token limit before its end."""
    refusal: str | None = None
    """The server's or the model's own way of refusing, apart from the text."""


class ChatServer(Protocol):
    """One call of one API. Its library's errors come out as those of `errors`; it never tries again by itself."""

    name: str
    """Of the model."""
    strict: bool
    """Whether it takes only the narrow JSON Schema of `prompt_json.strict_schema`."""

    async def ask(self, chat: Chat, form: dict[str, Any] | None, *, max_tokens: int) -> Reply:
        """Return the answer, in the form of a JSON Schema if there is one."""
        ...


class RemoteModel:
    """A model behind a server: a `PlanningModel` and a `TextModel`."""

    def __init__(self, server: ChatServer, budget: Budget) -> None:
        self._server = server
        self._budget = budget

    async def plan(self, request: PlanRequest) -> PlanDraft:
        """Return a draft; see `llm.PlanningModel`."""
        form = strict_schema(request) if self._server.strict else answer_schema(request)
        reply, latency_s = await self._ask(
            messages(request), form, timeout_s=request.timeout_s, max_tokens=request.max_tokens
        )
        if reply.refusal is not None:
            parsed = reply.refusal
        else:
            try:
                parsed = parse_answer(reply.text)
            except AnswerError as error:
                error.raw, error.tokens_in, error.tokens_out = reply.text, reply.tokens_in, reply.tokens_out
                raise
        refused = isinstance(parsed, str)
        return PlanDraft(
            plan=None if refused else parsed,
            refusal=parsed if refused else None,
            raw=reply.text,
            latency_s=latency_s,
            tokens_in=reply.tokens_in,
            tokens_out=reply.tokens_out,
        )

    async def complete(self, chat: Chat, *, timeout_s: float, max_tokens: int) -> TextAnswer:
        """Return an answer in free text; see `llm.TextModel`."""
        reply, latency_s = await self._ask(chat, None, timeout_s=timeout_s, max_tokens=max_tokens)
        return TextAnswer(reply.refusal or reply.text, latency_s, reply.tokens_in, reply.tokens_out)

    async def _ask(
        self, chat: Chat, form: dict[str, Any] | None, *, timeout_s: float, max_tokens: int
    ) -> tuple[Reply, float]:
        begin = time.monotonic()
        size = sum(len(m["content"]) for m in chat) + (len(json.dumps(form)) if form else 0)
        # Whatever ends the call without a word on its cost, also a cancellation, has cost as much as it could.
        held = self._budget.hold(round(size / CHARACTERS_PER_TOKEN) + max_tokens)
        try:
            async with asyncio.timeout(timeout_s):
                reply = await self._server.ask(chat, form, max_tokens=max_tokens)
        except TimeoutError as error:
            message = f"The model {self._server.name} did not answer within {timeout_s:.0f} s. Say it shorter."
            raise ModelTimeoutError(message) from error
        except (SetupError, ModelBusyError):
            held.settle(0)
            raise
        held.settle(reply.tokens_in + reply.tokens_out)
        if reply.cut:
            message = "The model's answer was cut off before its end. Send it as several shorter instructions."
            raise TruncatedAnswerError(message, raw=reply.text, tokens_in=reply.tokens_in, tokens_out=reply.tokens_out)
        return reply, time.monotonic() - begin


def retry_after_s(headers: Mapping[str, str]) -> float | None:
    """Return how long a server wants to be left alone (`retry-after`: seconds or a date); None if it does not say."""
    said = headers.get("retry-after", "").strip()
    try:
        return max(0.0, float(said))
    except ValueError:
        pass
    try:
        return max(0.0, email.utils.parsedate_to_datetime(said).timestamp() - time.time())
    except ValueError:
        return None


def without_key(text: str, access: Access) -> str:
    """Return a server's words, short, and without the key should they repeat it."""
    return (text.replace(access.secret, "***") if access.secret else text)[:500]
