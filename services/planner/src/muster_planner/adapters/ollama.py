"""The `ollama` adapter: any model of an Ollama server, held to the plan form by a JSON Schema."""

import asyncio
import time
from collections.abc import AsyncGenerator, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import Any

import httpx
from ollama import AsyncClient, ChatResponse, ResponseError

from muster_planner.errors import (
    AnswerError,
    ModelMissingError,
    ModelTimeoutError,
    ServerMissingError,
    SetupError,
    TruncatedAnswerError,
)
from muster_planner.llm import PlanDraft, PlanRequest, TextAnswer
from muster_planner.prompt_json import answer_schema, messages, parse_answer

_CONTEXT_SIZES = (4_096, 8_192, 16_384, 32_768, 65_536, 131_072)
"""In tokens. Few sizes, because the server loads a model anew when the size changes."""

_CHARACTERS_PER_TOKEN = 2.5
"""A low estimate: a prompt that does not fit is cut by the server without a word."""


class OllamaModel:
    """One model of one server."""

    def __init__(self, client: AsyncClient, name: str) -> None:
        self._client = client
        self._name = name

    async def plan(self, request: PlanRequest) -> PlanDraft:
        """Return a draft; see `llm.PlanningModel`."""
        answer = await self._answer(
            messages(request), answer_schema(request), timeout_s=request.timeout_s, max_tokens=request.max_tokens
        )
        try:
            parsed = parse_answer(answer.text)
        except AnswerError as error:
            error.raw, error.tokens_in, error.tokens_out = answer.text, answer.tokens_in, answer.tokens_out
            raise
        is_refusal = isinstance(parsed, str)
        return PlanDraft(
            plan=None if is_refusal else parsed,
            refusal=parsed if is_refusal else None,
            raw=answer.text,
            latency_s=answer.latency_s,
            tokens_in=answer.tokens_in,
            tokens_out=answer.tokens_out,
        )

    async def complete(self, chat: Sequence[Mapping[str, str]], *, timeout_s: float, max_tokens: int) -> TextAnswer:
        """Return an answer in free text; see `llm.TextModel`."""
        return await self._answer(chat, None, timeout_s=timeout_s, max_tokens=max_tokens)

    async def _answer(
        self, chat: Sequence[Mapping[str, str]], form: dict[str, Any] | None, *, timeout_s: float, max_tokens: int
    ) -> TextAnswer:
        begin = time.monotonic()
        try:
            async with asyncio.timeout(timeout_s):
                answer = await self._chat(chat, form, max_tokens)
        except TimeoutError as error:
            message = f"The model {self._name} did not answer within {timeout_s:.0f} s. Say it shorter."
            raise ModelTimeoutError(message) from error
        raw = answer.message.content or ""
        tokens_in, tokens_out = answer.prompt_eval_count or 0, answer.eval_count or 0
        if answer.done_reason == "length":
            message = "The model's answer was cut off before its end. Send it as several shorter instructions."
            raise TruncatedAnswerError(message, raw=raw, tokens_in=tokens_in, tokens_out=tokens_out)
        return TextAnswer(raw, time.monotonic() - begin, tokens_in, tokens_out)

    async def _chat(
        self, chat: Sequence[Mapping[str, str]], form: dict[str, Any] | None, max_tokens: int
    ) -> ChatResponse:
        options = {
            "temperature": 0,
            "seed": 1,
            "num_predict": max_tokens,
            "num_ctx": _context_size(chat, max_tokens),
        }
        try:
            return await self._client.chat(  # pyright: ignore[reportUnknownMemberType] (its `tools` is not typed)
                self._name, chat, format=form, options=options
            )
        except ResponseError as error:
            if error.status_code == 404:
                message = f"The Ollama server does not have the model {self._name}. Run `ollama pull {self._name}`."
                raise ModelMissingError(message) from error
            message = f"The Ollama server could not run {self._name} (HTTP {error.status_code}): {error.error}"[:900]
            raise SetupError(f"{message}. Look into its log.") from error
        except (ConnectionError, httpx.TransportError) as error:
            message = "No Ollama server answers. Start it with `ollama serve`, or say where it is in OLLAMA_HOST."
            raise ServerMissingError(message) from error
        except (ValueError, TypeError, AttributeError) as error:
            # what the client raises when the body is not what the API documents, as of a proxy or another server
            message = "What answers at OLLAMA_HOST does not speak Ollama's API. Check the address."
            raise SetupError(message) from error


@asynccontextmanager
async def open_ollama(name: str, host: str | None = None) -> AsyncGenerator[OllamaModel]:
    """Make a client; the server is first asked with the first instruction.

    Args:
        name: the model, as `ollama list` shows it.
        host: URL of the server; None: what `OLLAMA_HOST` says, else the local one.

    """
    client = AsyncClient(host)
    try:
        yield OllamaModel(client, name)
    finally:
        await client.close()


def _context_size(chat: Sequence[Mapping[str, str]], max_tokens: int) -> int:
    needed = sum(len(m["content"]) for m in chat) / _CHARACTERS_PER_TOKEN + max_tokens
    return next((size for size in _CONTEXT_SIZES if size >= needed), _CONTEXT_SIZES[-1])
