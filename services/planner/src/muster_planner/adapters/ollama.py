"""The `ollama` adapter: any model of an Ollama server, held to the plan form by a JSON Schema."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

import httpx
from ollama import AsyncClient, ResponseError

from muster_planner.errors import ModelBusyError, ModelMissingError, ServerMissingError, SetupError

from .remote import CHARACTERS_PER_TOKEN, Access, Chat, Reply

_CONTEXT_SIZES = (4_096, 8_192, 16_384, 32_768, 65_536, 131_072)
"""In tokens. Few sizes, because the server loads a model anew when the size changes, and cuts what does not fit."""


class OllamaServer:
    """One model of one server; see `remote.ChatServer`."""

    strict = False

    def __init__(self, client: AsyncClient, name: str) -> None:
        self._client = client
        self.name = name

    async def ask(self, chat: Chat, form: dict[str, Any] | None, *, max_tokens: int) -> Reply:
        """Return the answer; see `remote.ChatServer`."""
        options = {"temperature": 0, "seed": 1, "num_predict": max_tokens, "num_ctx": _context_size(chat, max_tokens)}
        try:
            answer = await self._client.chat(  # pyright: ignore[reportUnknownMemberType] (its `tools` is not typed)
                self.name, chat, format=form, options=options
            )
        except ResponseError as error:
            if error.status_code == 404:
                message = f"The Ollama server does not have the model {self.name}. Run `ollama pull {self.name}`."
                raise ModelMissingError(message) from error
            if error.status_code in (429, 503):
                message = f"The Ollama server has too much to do ({error.error}). Send it again later."[:900]
                raise ModelBusyError(message) from error
            message = f"The Ollama server could not run {self.name} (HTTP {error.status_code}): {error.error}"[:900]
            raise SetupError(f"{message}. Look into its log.") from error
        except (ConnectionError, httpx.TransportError) as error:
            message = "No Ollama server answers. Start it with `ollama serve`, or say where it is in OLLAMA_HOST."
            raise ServerMissingError(message) from error
        except (ValueError, TypeError, AttributeError) as error:
            # what the client raises when the body is not what the API documents, as of a proxy or another server
            message = "What answers at OLLAMA_HOST does not speak Ollama's API. Check the address."
            raise SetupError(message) from error
        tokens_in, tokens_out = answer.prompt_eval_count or 0, answer.eval_count or 0
        return Reply(answer.message.content or "", tokens_in, tokens_out, cut=answer.done_reason == "length")


@asynccontextmanager
async def open_ollama(name: str, access: Access) -> AsyncGenerator[OllamaServer]:
    """Make a client; the server is first asked with the first instruction.

    Args:
        name: the model, as `ollama list` shows it.
        access: URL of the server; none: the local one.

    """
    client = AsyncClient(access.url)
    try:
        yield OllamaServer(client, name)
    finally:
        await client.close()


def _context_size(chat: Chat, max_tokens: int) -> int:
    needed = sum(len(m["content"]) for m in chat) / CHARACTERS_PER_TOKEN + max_tokens
    return next((size for size in _CONTEXT_SIZES if size >= needed), _CONTEXT_SIZES[-1])
