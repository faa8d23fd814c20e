"""Whatever goes wrong at a model's server: an error that says what to do, never the key, and no end of spending."""

import asyncio
import logging
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import pytest
from muster_bus.testing import free_port
from muster_planner.adapters.anthropic import open_anthropic
from muster_planner.adapters.ollama import open_ollama
from muster_planner.adapters.openai import open_openai
from muster_planner.adapters.remote import Access, RemoteModel, retry_after_s
from muster_planner.budget import Budget, Unlimited
from muster_planner.errors import (
    KeyRefusedError,
    ModelBusyError,
    ModelMissingError,
    ModelTimeoutError,
    PlanningError,
    ServerMissingError,
    SetupError,
    TruncatedAnswerError,
    UnusableAnswerError,
)
from muster_planner.llm import PlanDraft, open_model
from muster_planner.published import published_form
from muster_planner.settings import ModelServers
from muster_planner.surroundings import Surroundings
from muster_planner.testing import DRIVE, YARD
from muster_planner.testing_servers import (
    ModelServer,
    anthropic_fails,
    anthropic_says,
    fails,
    model_server,
    openai_fails,
    openai_says,
    says,
)
from pydantic import SecretStr
from starlette.responses import PlainTextResponse, Response

SECRET = "sk-0123456789-very-secret"  # noqa: S105  (of this test)
PLAN = published_form(DRIVE)


@dataclass(frozen=True)
class Api:
    """One of the three, and how its server speaks."""

    name: str
    open: Callable[..., Any]
    path: str
    says: Callable[..., Response]
    fails: Callable[..., Response]


APIS = (
    Api("ollama", open_ollama, "", says, fails),
    Api("openai", open_openai, "/v1", openai_says, openai_fails),
    Api("anthropic", open_anthropic, "", anthropic_says, anthropic_fails),
)
WITH_KEY = APIS[1:]
every = pytest.mark.parametrize("api", APIS, ids=lambda a: a.name)
with_key = pytest.mark.parametrize("api", WITH_KEY, ids=lambda a: a.name)


FAILURES: dict[str, tuple[Callable[[Api], Response], type[PlanningError], str]] = {
    "no such model": (lambda a: a.fails(404, "model not found"), ModelMissingError, "some-model"),
    "bad request": (lambda a: a.fails(400, "prompt is too long"), SetupError, "too long"),
    "rate limit": (lambda a: a.fails(429, "slow down"), ModelBusyError, "later"),
    "overload": (lambda a: a.fails(503, "overloaded"), ModelBusyError, "later"),
    "truncated": (lambda a: a.says('{"tasks": [{"task": "dri', "cut"), TruncatedAnswerError, "shorter"),
    "words": (lambda a: a.says("Sure! Here is the plan."), UnusableAnswerError, "JSON"),
    "nesting": (lambda a: a.says("[" * 100_000), UnusableAnswerError, "JSON"),
    "no plan": (lambda a: a.says({"tasks": [{"task": "a"}]}), UnusableAnswerError, "instruction_function"),
    "silence": (lambda a: a.says(""), UnusableAnswerError, "JSON"),
    "a web page": (lambda _: PlainTextResponse("<html>It works!</html>"), SetupError, "does not speak"),
    "half a document": (lambda _: PlainTextResponse("{", media_type="application/json"), SetupError, "does not speak"),
    "an empty document": (
        lambda _: PlainTextResponse("{}", media_type="application/json"),
        SetupError,
        "does not speak",
    ),
}


@pytest.fixture
def server() -> Generator[ModelServer]:
    """Provide a server."""
    with model_server() as running:
        yield running


@asynccontextmanager
async def opened(api: Api, url: str, budget: Budget | None = None) -> AsyncGenerator[RemoteModel]:
    """Open the adapter with a key."""
    async with api.open("some-model", Access(url=url + api.path, key=SecretStr(SECRET))) as found:
        yield RemoteModel(found, budget or Unlimited())


async def ask(api: Api, url: str, *, timeout_s: float = 60.0, budget: Budget | None = None) -> PlanDraft:
    """Ask once."""
    request = Surroundings.of_file(YARD).request("go to the soil", None, timeout_s=timeout_s, max_tokens=500)
    async with opened(api, url, budget) as model:
        return await model.plan(request)


@every
async def test_a_plan_becomes_a_draft_with_its_cost(api: Api, server: ModelServer) -> None:
    """As the model gave it."""
    server.answers = [api.says(PLAN)]
    draft = await ask(api, server.url)
    assert (draft.plan, draft.tokens_in, draft.tokens_out) == (DRIVE, 321, 45)
    assert server.requests[0]["model"] == "some-model"


@every
async def test_a_refusal_becomes_a_draft_without_a_plan(api: Api, server: ModelServer) -> None:
    """With the model's own words."""
    server.answers = [api.says({"tasks": None, "refusal": "There is no crane."})]
    assert (await ask(api, server.url)).refusal == "There is no crane."


@with_key
async def test_a_refusal_of_the_provider_is_one_too(api: Api, server: ModelServer) -> None:
    """Not every refusal is in the form that was asked for."""
    server.answers = [api.says("I will not help with this.", "refused")]
    assert (await ask(api, server.url)).refusal == "I will not help with this."


@every
@pytest.mark.parametrize("what", FAILURES)
async def test_each_failure_says_what_to_do(api: Api, server: ModelServer, what: str) -> None:
    """As an error of the port's own tree; the server was asked once."""
    answer, error, says_to = FAILURES[what]
    server.answers = [answer(api)]
    with pytest.raises(error, match=says_to):
        await ask(api, server.url)
    assert len(server.requests) == 1


@every
async def test_a_missing_server_is_said_so(api: Api) -> None:
    """With where it was looked for or how it is started."""
    with pytest.raises(ServerMissingError, match=r"No .*server answers"):
        await ask(api, f"http://127.0.0.1:{free_port()}")


@every
async def test_a_slow_answer_is_a_timeout(api: Api, server: ModelServer) -> None:
    """The call ends when the mission's time does."""

    async def slow(_: dict[str, Any]) -> Response:
        await asyncio.sleep(0.5)
        return api.says(PLAN)

    server.answers = [slow]
    with pytest.raises(ModelTimeoutError, match="shorter"):
        await ask(api, server.url, timeout_s=0.2)


@with_key
async def test_a_server_says_how_long_to_wait(api: Api, server: ModelServer) -> None:
    """The error carries it on."""
    server.answers = [api.fails(429, "slow down", retry_after="7")]
    with pytest.raises(ModelBusyError) as caught:
        await ask(api, server.url)
    assert caught.value.retry_after_s == 7


def test_the_pause_is_seconds_or_a_date_or_nothing() -> None:
    """As HTTP allows."""
    assert retry_after_s({"retry-after": "1.5"}) == 1.5
    assert retry_after_s({"retry-after": "Wed, 21 Oct 2015 07:28:00 GMT"}) == 0
    assert retry_after_s({"retry-after": "soon"}) is None
    assert retry_after_s({}) is None


@with_key
@pytest.mark.parametrize("status", [400, 401, 403, 404, 429, 500])
async def test_the_key_stands_in_no_error_and_no_log(
    api: Api, server: ModelServer, status: int, caplog: pytest.LogCaptureFixture
) -> None:
    """Even if the server repeats it; it was sent, though."""
    caplog.set_level(logging.DEBUG)
    server.answers = [api.fails(status, f"what about {SECRET}?")]
    with pytest.raises(PlanningError) as caught:
        await ask(api, server.url)
    assert SECRET in str(server.headers[0])
    assert SECRET not in f"{caught.value} {caught.value!r} {caplog.text} {Access(key=SecretStr(SECRET))}"


@with_key
@pytest.mark.parametrize("status", [401, 403])
async def test_a_refused_key_names_its_variable(api: Api, server: ModelServer, status: int) -> None:
    """Whoever runs the site sets another one."""
    server.answers = [api.fails(status, "no")]
    with pytest.raises(KeyRefusedError, match=f"{api.name.upper()}_API_KEY"):
        await ask(api, server.url)


@pytest.mark.parametrize("choice", ["openai:gpt-4o", "anthropic:claude"])
async def test_without_a_key_nothing_is_asked(choice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The vendors' services take nothing without one."""
    for name in ModelServers.model_fields:
        monkeypatch.delenv(name.upper(), raising=False)
    with pytest.raises(KeyRefusedError, match="_API_KEY"):
        async with open_model(choice):
            pass


async def test_what_a_server_does_not_take_is_left_out(server: ModelServer) -> None:
    """DeepSeek knows no JSON Schema, reasoning models no temperature; both are asked without from then on."""
    server.answers = [
        openai_fails(400, "This response_format type is unavailable now"),
        openai_fails(400, "Unsupported value", param="temperature"),
        openai_says(PLAN),
    ]
    request = Surroundings.of_file(YARD).request("go", None, timeout_s=60, max_tokens=500)
    async with opened(APIS[1], server.url) as model:
        assert (await model.plan(request)).plan == DRIVE
        assert (await model.plan(request)).plan == DRIVE
    assert len(server.requests) == 4
    assert server.requests[3]["response_format"] == {"type": "json_object"}
    assert "temperature" not in server.requests[3]


async def test_an_empty_account_is_not_asked_again(server: ModelServer) -> None:
    """It is no rate limit: somebody must pay."""
    server.answers = [openai_fails(429, "You exceeded your current quota", code="insufficient_quota")]
    with pytest.raises(SetupError, match="money"):
        await ask(APIS[1], server.url)
