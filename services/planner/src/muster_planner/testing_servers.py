"""Testing support: a server of models in a thread of its own, which speaks what three APIs document.

Ollama's `/api/chat`, OpenAI's `/v1/chat/completions`, Anthropic's `/v1/messages`. What it says is given beforehand, one
answer a request, or is written by a function of the request.
"""

import contextlib
import inspect
import json
import socket
import threading
from collections.abc import Awaitable, Callable, Generator, Mapping
from typing import Any, Literal

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

Answer = Response | Callable[[dict[str, Any]], Awaitable[Response] | Response]
End = Literal["end", "cut", "refused"]
TOKENS_IN, TOKENS_OUT = 321, 45
"""What the answers say that they have cost."""


class ModelServer:
    """What was asked, and what will be answered."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.requests: list[dict[str, Any]] = []
        self.headers: list[Mapping[str, str]] = []
        self.answers: list[Answer] = []
        """Taken from the front; the last one stays."""

    async def answer(self, request: Request) -> Response:
        """Answer one request."""
        body = json.loads(await request.body())
        self.requests.append(body)
        self.headers.append(dict(request.headers))
        answer = self.answers[0] if len(self.answers) == 1 else self.answers.pop(0)
        if isinstance(answer, Response):
            return answer
        given = answer(body)
        return await given if inspect.isawaitable(given) else given


@contextlib.contextmanager
def model_server() -> Generator[ModelServer]:
    """Run a server on a free port."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        server = ModelServer(f"http://127.0.0.1:{listening.getsockname()[1]}")
        paths = ("/api/chat", "/v1/chat/completions", "/v1/messages")
        app = Starlette(routes=[Route(path, server.answer, methods=["POST"]) for path in paths])
        runner = uvicorn.Server(uvicorn.Config(app, log_config=None, lifespan="off", timeout_graceful_shutdown=1))
        thread = threading.Thread(target=runner.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            yield server
        finally:
            runner.should_exit = True
            thread.join()


def says(content: object, end: End = "end", *, tokens_in: int = TOKENS_IN, tokens_out: int = TOKENS_OUT) -> Response:
    """Return the answer of an Ollama server whose model says this (as JSON, unless it is text)."""
    return JSONResponse(
        {
            "model": "llama3.1",
            "created_at": "2026-01-01T00:00:00.000000Z",
            "message": {"role": "assistant", "content": _text(content)},
            "done": True,
            "done_reason": "length" if end == "cut" else "stop",
            "total_duration": 1_000_000,
            "load_duration": 1_000,
            "prompt_eval_count": tokens_in,
            "prompt_eval_duration": 1_000,
            "eval_count": tokens_out,
            "eval_duration": 1_000,
        }
    )


def openai_says(
    content: object, end: End = "end", *, tokens_in: int = TOKENS_IN, tokens_out: int = TOKENS_OUT
) -> Response:
    """Return the same as OpenAI's chat completions say it."""
    refused = end == "refused"
    message = {
        "role": "assistant",
        "content": None if refused else _text(content),
        "refusal": content if refused else None,
    }
    usage = {"prompt_tokens": tokens_in, "completion_tokens": tokens_out, "total_tokens": tokens_in + tokens_out}
    finish = "length" if end == "cut" else "stop"
    return JSONResponse(
        {
            "id": "chatcmpl-1",
            "object": "chat.completion",
            "created": 1_760_000_000,
            "model": "gpt-4o",
            "choices": [{"index": 0, "message": message, "finish_reason": finish, "logprobs": None}],
            "usage": usage,
        }
    )


def anthropic_says(
    content: object, end: End = "end", *, tokens_in: int = TOKENS_IN, tokens_out: int = TOKENS_OUT
) -> Response:
    """Return the same as Anthropic's messages say it."""
    reasons: dict[End, str] = {"end": "end_turn", "cut": "max_tokens", "refused": "refusal"}
    refused = end == "refused"
    return JSONResponse(
        {
            "id": "msg_1",
            "type": "message",
            "role": "assistant",
            "model": "claude",
            "content": [] if refused else [{"type": "text", "text": _text(content)}],
            "stop_reason": reasons[end],
            "stop_sequence": None,
            "stop_details": {"type": "refusal", "category": None, "explanation": content} if refused else None,
            "usage": {"input_tokens": tokens_in, "output_tokens": tokens_out},
        }
    )


def fails(status: int, error: str, **headers: str) -> Response:
    """Return the answer of an Ollama server that cannot."""
    return JSONResponse({"error": error}, status_code=status, headers=_names(headers))


def openai_fails(
    status: int, error: str, *, code: str | None = None, param: str | None = None, **headers: str
) -> Response:
    """Return the same as OpenAI's API says it; `_` in a header's name stands for `-`."""
    body = {"error": {"message": error, "type": "error", "param": param, "code": code}}
    return JSONResponse(body, status_code=status, headers=_names(headers))


def anthropic_fails(status: int, error: str, **headers: str) -> Response:
    """Return the same as Anthropic's API says it."""
    body = {"type": "error", "error": {"type": "error", "message": error}, "request_id": "req_1"}
    return JSONResponse(body, status_code=status, headers=_names(headers))


def _names(headers: Mapping[str, str]) -> dict[str, str]:
    return {name.replace("_", "-"): value for name, value in headers.items()}


def _text(content: object) -> str:
    return content if isinstance(content, str) else json.dumps(content)
