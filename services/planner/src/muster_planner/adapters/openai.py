"""The `openai` adapter: OpenAI's service, and other servers of its API (llama.cpp, vLLM, DeepSeek).

Servers differ in what they take. What one refuses by name (a form of answer, a temperature) is left out from then on.
"""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any, Final, cast

import openai
from openai import AsyncOpenAI
from openai.types.chat import ChatCompletion

from muster_planner.errors import (
    KeyRefusedError,
    ModelBusyError,
    ModelMissingError,
    ServerMissingError,
    SetupError,
)

from .remote import Access, Chat, Reply, retry_after_s, without_key

_FORMS: Final = ("json_schema", "json_object", None)
"""From the best to the least; DeepSeek takes the second, some servers none. The prompt asks for JSON in any case."""
_OWN_URL: Final = "https://api.openai.com/v1"
_NO_KEY: Final = "none"
"""Sent to servers of one's own that want no key: the client insists on one."""


class OpenAIServer:
    """One model of one server; see `remote.ChatServer`."""

    def __init__(self, client: AsyncOpenAI, name: str, access: Access) -> None:
        self._client = client
        self._access = access
        self._forms = list(_FORMS)
        self._wishes: dict[str, Any] = {"temperature": 0, "seed": 1}
        self.name = name
        self.strict = access.url is None
        # the service has dropped the older name, which is the one that other servers know
        self._limit = "max_completion_tokens" if access.url is None else "max_tokens"

    async def ask(self, chat: Chat, form: dict[str, Any] | None, *, max_tokens: int) -> Reply:
        """Return the answer; see `remote.ChatServer`."""
        while True:
            fields: dict[str, Any] = {
                "model": self.name,
                "messages": list(chat),
                self._limit: max_tokens,
                **self._wishes,
            }
            kind = self._forms[0] if form is not None else None
            if kind == "json_schema":
                named = {"name": "plan", "schema": form, "strict": self.strict}
                fields["response_format"] = {"type": kind, "json_schema": named}
            elif kind is not None:
                fields["response_format"] = {"type": kind}
            try:
                return _reply(cast("ChatCompletion", await self._client.chat.completions.create(**fields)))
            except openai.BadRequestError as error:
                if not self._does_without(error):
                    raise self._mapped(error) from error
            except openai.APIError as error:
                raise self._mapped(error) from error
            except (ValueError, TypeError, AttributeError, IndexError) as error:
                # the body is not what the API documents, as of a proxy or another server
                raise SetupError(self._foreign()) from error

    def _does_without(self, error: openai.BadRequestError) -> bool:
        """Leave out what the server does not take, if it says so by name; return whether there was such a thing."""
        said = f"{error.param or ''} {error.message}"
        if "response_format" in said and len(self._forms) > 1:
            self._forms.pop(0)
            return True
        refused = [wish for wish in self._wishes if wish in said]
        for wish in refused:
            del self._wishes[wish]
        return bool(refused)

    def _mapped(self, error: openai.APIError) -> Exception:  # noqa: PLR0911  (a table)
        said = without_key(error.message, self._access)
        match error:
            case openai.APIConnectionError():
                return ServerMissingError(
                    f"No server answers at {self._client.base_url}. Start it, or say where it is in OPENAI_BASE_URL."
                )
            case openai.AuthenticationError() | openai.PermissionDeniedError():
                # the server's words may hold parts of the key
                return KeyRefusedError("The server refuses the key. Set one that it knows in OPENAI_API_KEY.")
            case openai.NotFoundError():
                return ModelMissingError(
                    f"The server at {self._client.base_url} does not have the model {self.name}. Name one of its own "
                    "after `openai:` in MUSTER_PLANNER."
                )
            case openai.RateLimitError() if error.code == "insufficient_quota":
                return SetupError("The account of OPENAI_API_KEY has no money left. Fill it up, or take another one.")
            case openai.RateLimitError() | openai.InternalServerError():
                return ModelBusyError(
                    f"The model's server cannot answer now (HTTP {error.status_code}): {said}. Send it again later.",
                    retry_after_s=retry_after_s(error.response.headers),
                )
            case openai.APIStatusError():
                return SetupError(f"The server could not run {self.name} (HTTP {error.status_code}): {said}.")
            case _:
                return SetupError(self._foreign())

    def _foreign(self) -> str:
        return f"What answers at {self._client.base_url} does not speak OpenAI's API. Check OPENAI_BASE_URL."


@asynccontextmanager
async def open_openai(name: str, access: Access) -> AsyncGenerator[OpenAIServer]:
    """Make a client; the server is first asked with the first instruction.

    Args:
        name: the model, as the server calls it.
        access: URL of the API (`http://127.0.0.1:8080/v1`), none: OpenAI's own; and the key.

    Raises:
        KeyRefusedError: OpenAI's own service wants a key, and there is none.

    """
    if access.url is None and not access.secret:
        raise KeyRefusedError(
            "OpenAI's service wants a key. Set OPENAI_API_KEY, or OPENAI_BASE_URL to your own server."
        )
    # the planner decides what is tried again, and counts it
    client = AsyncOpenAI(api_key=access.secret or _NO_KEY, base_url=access.url or _OWN_URL, max_retries=0)
    try:
        yield OpenAIServer(client, name, access)
    finally:
        await client.close()


def _reply(answer: ChatCompletion) -> Reply:
    choice = answer.choices[0]
    usage = answer.usage
    refusal = choice.message.refusal
    if choice.finish_reason == "content_filter":
        refusal = refusal or "The model's provider filters this instruction out. Say it in other words."
    return Reply(
        text=choice.message.content or "",
        tokens_in=usage.prompt_tokens if usage else 0,
        tokens_out=usage.completion_tokens if usage else 0,
        cut=choice.finish_reason == "length",
        refusal=refusal,
    )
