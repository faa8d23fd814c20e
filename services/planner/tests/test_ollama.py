"""The `ollama` adapter against a server that speaks Ollama's documented API over real HTTP."""

import asyncio
import json
from collections.abc import Generator
from typing import Any

import jsonschema_rs
import pytest
from muster_bus.testing import free_port
from muster_planner.adapters.ollama import open_ollama
from muster_planner.adapters.remote import Access, RemoteModel
from muster_planner.budget import Unlimited
from muster_planner.errors import (
    AnswerError,
    ModelMissingError,
    ModelTimeoutError,
    ServerMissingError,
    SetupError,
    TruncatedAnswerError,
    UnusableAnswerError,
)
from muster_planner.llm import Feedback, PlanDraft, PlanRequest
from muster_planner.published import published_form
from muster_planner.surroundings import Surroundings
from muster_planner.testing import DRIVE, NOWHERE, YARD
from muster_planner.testing_servers import ModelServer, fails, model_server, says
from muster_schemas.mission import Reason
from starlette.responses import PlainTextResponse, Response

REQUEST = Surroundings.of_file(YARD).request("go to the soil", None, timeout_s=20, max_tokens=500)
PLAN = published_form(DRIVE)


@pytest.fixture
def server() -> Generator[ModelServer]:
    """Provide an Ollama server."""
    with model_server() as running:
        yield running


async def ask(server: ModelServer, request: PlanRequest = REQUEST) -> PlanDraft:
    """Ask the server's model once."""
    async with open_ollama("llama3.1", Access(url=server.url)) as opened:
        return await RemoteModel(opened, Unlimited()).plan(request)


async def test_a_plan_in_the_published_form_becomes_a_draft(server: ModelServer) -> None:
    """With its cost."""
    server.answers = [says(PLAN)]
    draft = await ask(server)
    assert draft.plan == DRIVE
    assert (draft.tokens_in, draft.tokens_out) == (321, 45)
    assert json.loads(draft.raw) == PLAN


async def test_a_refusal_becomes_a_draft_without_a_plan(server: ModelServer) -> None:
    """With the model's own words."""
    server.answers = [says({"refusal": "There is no crane."})]
    assert (await ask(server)).refusal == "There is no crane."


async def test_the_request_is_deterministic_structured_and_large_enough(server: ModelServer) -> None:
    """Temperature 0, a JSON Schema, no stream, room for the prompt and the answer."""
    server.answers = [says(PLAN)]
    await ask(server)
    (sent,) = server.requests
    assert (sent["model"], sent["stream"]) == ("llama3.1", False)
    assert sent["options"]["temperature"] == 0
    assert sent["options"]["num_predict"] == 500
    prompt = sum(len(m["content"]) for m in sent["messages"])
    assert sent["options"]["num_ctx"] >= prompt / 3 + 500
    assert sent["format"]["anyOf"]


async def test_the_schema_takes_plans_and_refusals_of_this_site_only(server: ModelServer) -> None:
    """Robots, types and skills are closed lists; an object may be one that is yet to be found."""
    server.answers = [says(PLAN)]
    await ask(server)
    schema = jsonschema_rs.validator_for(server.requests[0]["format"])
    assert schema.is_valid(PLAN)
    assert schema.is_valid(published_form(NOWHERE))
    assert schema.is_valid({"refusal": "no"})
    empty: list[dict[str, Any]] = [{}, {"tasks": []}, {"tasks": [], "refusal": "no"}]
    for wrong in (*empty, _with(robot_ids=["robot_crane_01"]), _with(name="fly")):
        assert not schema.is_valid(wrong), wrong


async def test_the_prompt_names_what_is_here(server: ModelServer) -> None:
    """Every robot, object and skill of the request, the instruction, and no other robot."""
    server.answers = [says(PLAN)]
    two = Surroundings(REQUEST.roster[:2], ("soil1",), REQUEST.catalogue, {})
    await ask(server, two.request("dig it", None, timeout_s=20, max_tokens=500))
    system, user = (m["content"] for m in server.requests[0]["messages"])
    assert user == "Instruction: dig it"
    assert all(c.robot_id in system for c in two.roster)
    assert "robot_dump_truck_01" not in system
    assert "Excavation (excavator only)" in system
    assert "DumpUnloading" not in system
    assert "puddle1" not in system


async def test_a_repair_says_what_was_wrong(server: ModelServer) -> None:
    """The refused answer and the reasons follow the instruction."""
    server.answers = [says(PLAN)]
    reasons = (Reason(code="unknown_object", message="There is no 'puddle7'.", task="only"),)
    feedback = Feedback(reasons=reasons, raw="{}", plan=NOWHERE)
    await ask(server, Surroundings.of_file(YARD).request("go", feedback, timeout_s=20, max_tokens=500))
    messages = server.requests[0]["messages"]
    assert [m["role"] for m in messages] == ["system", "user", "assistant", "user"]
    assert "puddle7" in messages[2]["content"]
    assert "There is no 'puddle7'." in messages[3]["content"]


@pytest.mark.parametrize(
    ("answer", "error", "says_to"),
    [
        (fails(404, "model 'llama3.1' not found"), ModelMissingError, "ollama pull llama3.1"),
        (fails(500, "model requires more system memory"), SetupError, "more system memory"),
        (fails(400, "invalid options"), SetupError, "invalid options"),
        (says('{"tasks": [{"task": "dri', "cut"), TruncatedAnswerError, "shorter"),
        (says("Sure! Here is the plan."), UnusableAnswerError, "JSON"),
        (says({"tasks": [{"task": "a"}]}), UnusableAnswerError, "instruction_function"),
        (says(["go"]), UnusableAnswerError, "no plan"),
        (says(""), UnusableAnswerError, "JSON"),
        (PlainTextResponse("<html>It works!</html>"), SetupError, "OLLAMA_HOST"),
    ],
)
async def test_each_failure_says_what_to_do(
    server: ModelServer, answer: Response, error: type[Exception], says_to: str
) -> None:
    """As an error of the port's own tree."""
    server.answers = [answer]
    with pytest.raises(error, match=says_to):
        await ask(server)


async def test_what_an_unusable_answer_cost_is_kept(server: ModelServer) -> None:
    """Tokens count against the mission's cap, and the raw answer is there for the repair."""
    server.answers = [says("Sure!")]
    with pytest.raises(AnswerError) as caught:
        await ask(server)
    assert (caught.value.raw, caught.value.tokens_in, caught.value.tokens_out) == ("Sure!", 321, 45)


async def test_a_slow_answer_is_a_timeout(server: ModelServer) -> None:
    """The call ends when the mission's time does, not when the server pleases."""
    asked = asyncio.Event()

    async def slow(_: dict[str, Any]) -> Response:
        asked.set()
        await asyncio.sleep(3)
        return says(PLAN)

    server.answers = [slow]
    with pytest.raises(ModelTimeoutError, match="shorter"):
        await ask(server, Surroundings.of_file(YARD).request("go", None, timeout_s=0.3, max_tokens=500))


async def test_a_missing_server_is_said_so() -> None:
    """With how to start it."""
    async with open_ollama("llama3.1", Access(url=f"http://127.0.0.1:{free_port()}")) as opened:
        with pytest.raises(ServerMissingError, match="ollama serve"):
            await RemoteModel(opened, Unlimited()).plan(REQUEST)


def _with(**fields: object) -> dict[str, Any]:
    plan = published_form(DRIVE)
    plan["tasks"][0]["instruction_function"].update(fields)
    return plan
