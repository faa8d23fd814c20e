"""The `anthropic` adapter: models behind Anthropic's Messages API, held to the plan form by a JSON Schema."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any, Final, cast

import anthropic
from anthropic import AsyncAnthropic
from anthropic.types import Message

from muster_planner.errors import (
    KeyRefusedError,
    ModelBusyError,
    ModelMissingError,
    ServerMissingError,
    SetupError,
)

from .remote import Access, Chat, Reply, retry_after_s, without_key

_OWN_URL: Final = "https://api.anthropic.com"


class AnthropicServer:
    """One model of the service; see `remote.ChatServer`."""

    strict = True

    def __init__(self, client: AsyncAnthropic, name: str, access: Access) -> None:
        self._client = client
        self._access = access
        self.name = name

    async def ask(self, chat: Chat, form: dict[str, Any] | None, *, max_tokens: int) -> Reply:
        """Return the answer; see `remote.ChatServer`."""
        fields: dict[str, Any] = {
            "model": self.name,
            "max_tokens": max_tokens,
            "system": "\n\n".join(m["content"] for m in chat if m["role"] == "system"),
            "messages": [m for m in chat if m["role"] != "system"],
        }
        if form is not None:
            fields["output_config"] = {"format": {"type": "json_schema", "schema": form}}
        try:
            return _reply(cast("Message", await self._client.messages.create(**fields)))
        except anthropic.APIError as error:
            raise self._mapped(error) from error
        except (ValueError, TypeError, AttributeError) as error:
            # the body is not what the API documents, as of a proxy or another server
            raise SetupError(self._foreign()) from error

    def _mapped(self, error: anthropic.APIError) -> Exception:
        said = without_key(error.message, self._access)
        match error:
            case anthropic.APIConnectionError():
                return ServerMissingError(
                    f"No server answers at {self._client.base_url}. See whether this machine reaches it, or say where "
                    "it is in ANTHROPIC_BASE_URL."
                )
            case anthropic.AuthenticationError() | anthropic.PermissionDeniedError():
                # the server's words may hold parts of the key
                return KeyRefusedError("The server refuses the key. Set one that it knows in ANTHROPIC_API_KEY.")
            case anthropic.NotFoundError():
                return ModelMissingError(
                    f"There is no model {self.name}. Name another one after `anthropic:` in MUSTER_PLANNER."
                )
            case anthropic.RateLimitError() | anthropic.InternalServerError():
                return ModelBusyError(
                    f"The model's server cannot answer now (HTTP {error.status_code}): {said}. Send it again later.",
                    retry_after_s=retry_after_s(error.response.headers),
                )
            case anthropic.APIStatusError():
                return SetupError(f"The server could not run {self.name} (HTTP {error.status_code}): {said}.")
            case _:
                return SetupError(self._foreign())

    def _foreign(self) -> str:
        return f"What answers at {self._client.base_url} does not speak Anthropic's API. Check ANTHROPIC_BASE_URL."


@asynccontextmanager
async def open_anthropic(name: str, access: Access) -> AsyncGenerator[AnthropicServer]:
    """Make a client; the server is first asked with the first instruction.

    Args:
        name: the model, as the service calls it.
        access: URL of the API, none: Anthropic's own; and the key.

    Raises:
        KeyRefusedError: there is no key.

    """
    if not access.secret:
        raise KeyRefusedError("Anthropic's service wants a key. Set ANTHROPIC_API_KEY.")
    # the planner decides what is tried again, and counts it
    client = AsyncAnthropic(api_key=access.secret, base_url=access.url or _OWN_URL, max_retries=0)
    try:
        yield AnthropicServer(client, name, access)
    finally:
        await client.close()


def _reply(answer: Message) -> Reply:
    refusal = None
    if answer.stop_reason == "refusal":
        why = answer.stop_details.explanation if answer.stop_details else None
        refusal = why or "The model refuses this instruction. Say it in other words."
    return Reply(
        text="".join(block.text for block in answer.content if block.type == "text"),
        tokens_in=cast("int | None", answer.usage.input_tokens) or 0,
        tokens_out=cast("int | None", answer.usage.output_tokens) or 0,
        cut=answer.stop_reason in ("max_tokens", "model_context_window_exceeded"),
        refusal=refusal,
    )
