"""The embedded model, loaded once, plans on the site that each request describes."""

import asyncio
from collections.abc import AsyncGenerator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
import pytest_asyncio
from muster_planner import embedded_files
from muster_planner.embedded import EmbeddedModel, open_embedded
from muster_planner.errors import ModelMissingError, ModelTimeoutError, TruncatedAnswerError
from muster_planner.llm import Feedback, PlanRequest
from muster_planner.surroundings import Surroundings
from muster_schemas.gate import check_plan
from muster_schemas.mission import Reason
from muster_schemas.plan import Plan
from muster_schemas.site import load_site

YARD = Surroundings.of_file(load_site(Path(__file__).resolve().parents[3] / "sites" / "yard.yaml"))

pytestmark = pytest.mark.asyncio(loop_scope="module")


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def model() -> AsyncGenerator[EmbeddedModel]:
    """Provide the loaded model; one thread, since others test beside."""
    async with open_embedded(threads=1) as loaded:
        yield loaded


def request(text: str, timeout_s: float = 120.0, max_tokens: int = 2048) -> PlanRequest:
    """Return a request on the default site."""
    return YARD.request(text, None, timeout_s=timeout_s, max_tokens=max_tokens)


def tasks_of(plan: Plan | None) -> Sequence[tuple[str, Sequence[str], Sequence[str]]]:
    """Return (skill, robots, objects) of each task."""
    assert plan is not None
    functions = [t.instruction_function for t in plan.tasks]
    return [(f.skill, f.robot_ids, f.object_keywords) for f in functions]


async def test_a_plain_order_becomes_its_plan(model: EmbeddedModel) -> None:
    """One robot, one place, one task."""
    draft = await model.plan(request("Truck 2 drives to puddle 1."))
    expected = ("target_area_for_specific_robots", ("robot_dump_truck_02",), ("puddle1",))
    assert tasks_of(draft.plan) == [expected]
    assert draft.tokens_out == 4  # verb, robot, place, end
    assert draft.raw == "a go T2 @ puddle1"


async def test_names_of_another_site_are_used(model: EmbeddedModel) -> None:
    """The roster and the objects come from the request, not from the training."""
    roster = tuple(c.model_copy(update={"robot_id": f"mine-{c.robot_id}"}) for c in YARD.roster)
    asked = replace(request("Excavator 1 drives to gate 1."), roster=roster, objects=("gate1", "shed1"))
    draft = await model.plan(asked)
    assert tasks_of(draft.plan) == [("target_area_for_specific_robots", ("mine-robot_excavator_01",), ("gate1",))]


async def test_every_answer_is_a_refusal_or_passes_the_gate(model: EmbeddedModel) -> None:
    """Whatever the text is, no choice leads to an unknown name or a cycle."""
    texts = (
        "asdf qwer",
        "Truck 9 digs at the moon until it sings.",
        "1. 2. 3.",
        "DROP TABLE robots; everyone to soil 9",
        "🚜",
    )
    for text in texts:
        try:
            draft = await model.plan(request(text))
        except TruncatedAnswerError:
            continue
        assert draft.refusal or (draft.plan and check_plan(draft.plan, YARD.roster, YARD.objects, YARD.catalogue) == [])


async def test_requests_queue_without_blocking_the_loop(model: EmbeddedModel) -> None:
    """Several calls at once are all answered, while the event loop goes on."""
    turns = 0

    async def count() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    counting = asyncio.create_task(count())
    drafts = await asyncio.gather(*(model.plan(request(f"Truck {n} goes home.")) for n in (1, 2, 3)))
    counting.cancel()
    assert [tasks_of(d.plan)[0][1] for d in drafts] == [(f"robot_dump_truck_0{n}",) for n in (1, 2, 3)]
    assert turns > 100


async def test_an_answer_that_takes_too_long_is_given_up(model: EmbeddedModel) -> None:
    """The time limit is kept, and the model is free again afterwards."""
    with pytest.raises(ModelTimeoutError):
        await model.plan(request("Excavator 1 goes to soil 1 and digs.", timeout_s=0.000_1))
    assert (await model.plan(request("Truck 1 goes home."))).plan


async def test_a_cancelled_call_leaves_the_model_free(model: EmbeddedModel) -> None:
    """Cancelling stops the computation."""
    call = asyncio.create_task(model.plan(request("Excavator 1 goes to soil 1, digs, and truck 1 goes home.")))
    await asyncio.sleep(0)
    call.cancel()
    with pytest.raises(asyncio.CancelledError):
        await call
    assert (await model.plan(request("Truck 1 goes home."))).plan


async def test_an_answer_over_the_token_limit_is_an_error(model: EmbeddedModel) -> None:
    """Half a plan is no plan."""
    with pytest.raises(TruncatedAnswerError) as caught:
        await model.plan(request("Excavator 1 goes to soil 1 and digs.", max_tokens=4))
    assert caught.value.tokens_out <= 4


async def test_a_repair_is_another_answer_than_the_refused_one(model: EmbeddedModel) -> None:
    """With feedback the next likeliest answer is given."""
    asked = request("Truck 1 goes home.")
    first = await model.plan(asked)
    feedback = Feedback(reasons=(Reason(code="robot_unable", message="Truck 1 cannot."),), raw=first.raw)
    second = await model.plan(replace(asked, feedback=feedback))
    assert second.raw != first.raw


async def test_a_refusal_says_what_would_do(model: EmbeddedModel) -> None:
    """The operator learns why, and what is there."""
    draft = await model.plan(request("Thank you all for yesterday, the cake was great!"))
    assert draft.plan is None
    assert draft.refusal
    assert draft.refusal.endswith(".")
    assert draft.raw.startswith("refuse ")


async def test_too_long_a_text_is_an_error_that_says_what_to_do(model: EmbeddedModel) -> None:
    """It is not cut."""
    with pytest.raises(TruncatedAnswerError, match="Send it as several"):
        await model.plan(request("Truck 1 goes home. " * 150))


async def test_a_missing_file_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Without its file the model is not loaded."""
    monkeypatch.setattr(embedded_files, "FOLDER", tmp_path)
    with pytest.raises(ModelMissingError, match=r"reader\.onnx"):
        async with open_embedded():
            pass
