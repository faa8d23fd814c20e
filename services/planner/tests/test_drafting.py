"""Draft, gate, repair, reject: with models written as functions and the default site's file."""

from collections.abc import Callable, Collection, Sequence

import pytest
from muster_planner.drafting import ATTEMPTS, Limits, draft_plan
from muster_planner.errors import (
    ModelMissingError,
    ModelTimeoutError,
    PlanningError,
    ServerMissingError,
    TruncatedAnswerError,
    UnusableAnswerError,
)
from muster_planner.llm import PlanDraft, PlanRequest
from muster_planner.scenes import FileScene
from muster_planner.surroundings import Surroundings
from muster_planner.testing import DRIVE, NOWHERE, YARD, Answer, FunctionModel, one_task
from muster_schemas.mission import Reason
from muster_schemas.plan import Plan

SCENE = FileScene(YARD)


def in_turn(*answers: Answer | PlanningError) -> Callable[[PlanRequest], Answer]:
    """Return a model's function that gives (or raises) these one after the other."""
    left = list(answers)

    def answer(_: PlanRequest) -> Answer:
        given = left.pop(0)
        if isinstance(given, PlanningError):
            raise given
        return given

    return answer


async def test_a_plan_that_passes_the_gate_is_the_outcome() -> None:
    """One call, no reasons, its cost counted."""
    model = FunctionModel(in_turn(DRIVE))
    outcome = await draft_plan("go", model, SCENE)
    assert (outcome.plan, outcome.reasons, outcome.attempts, outcome.tokens) == (DRIVE, (), 1, 20)


async def test_the_model_is_told_what_is_on_the_site_and_nothing_else() -> None:
    """Robots, objects and letters come from the site."""
    model = FunctionModel(in_turn(DRIVE))
    await draft_plan("go", model, SCENE)
    (request,) = model.requests
    assert [c.robot_id for c in request.roster] == [r.id for r in YARD.robots]
    assert request.objects == tuple(sorted(t.name for t in YARD.things))
    assert dict(request.letters) == {"excavator": "E", "dump_truck": "T"}
    assert request.feedback is None


async def test_a_refused_plan_is_repaired_with_the_reasons() -> None:
    """The second request holds the first draft and what is wrong with it."""
    model = FunctionModel(in_turn(NOWHERE, DRIVE))
    outcome = await draft_plan("go", model, SCENE)
    assert outcome.plan == DRIVE
    feedback = model.requests[1].feedback
    assert feedback is not None
    assert feedback.plan == NOWHERE
    assert [r.code for r in feedback.reasons] == ["unknown_object"]


async def test_after_two_repairs_the_instruction_is_rejected() -> None:
    """Three calls, then the last reasons, said for people."""
    model = FunctionModel(lambda _: NOWHERE)
    outcome = await draft_plan("go", model, SCENE)
    assert outcome.plan is None
    assert outcome.attempts == ATTEMPTS == 3
    assert "puddle7" in outcome.reasons[0].message


async def test_a_refusal_is_final() -> None:
    """What the model refuses it is not asked again."""
    model = FunctionModel(lambda _: "There is no crane.")
    outcome = await draft_plan("hoist", model, SCENE)
    assert [r.message for r in outcome.reasons] == ["There is no crane."]
    assert outcome.attempts == 1
    assert outcome.failure is None


@pytest.mark.parametrize(
    "plan",
    [
        Plan(tasks=()),
        one_task("juggle", "robot_excavator_01"),
        one_task("excavator_digging", "robot_dump_truck_01"),
        one_task("excavator_digging", "robot_excavator_09"),
        one_task("target_area_for_specific_robots", "robot_excavator_01"),
        one_task("return_to_start_for_specific_robots", "robot_excavator_01", "soil1"),
    ],
)
async def test_nothing_that_the_gate_refuses_comes_through(plan: Plan) -> None:
    """Whatever the model insists on."""
    outcome = await draft_plan("go", FunctionModel(lambda _: plan), SCENE)
    assert outcome.plan is None
    assert outcome.reasons


@pytest.mark.parametrize("error", [ModelTimeoutError, TruncatedAnswerError, UnusableAnswerError])
async def test_an_unusable_answer_is_tried_again(error: type[PlanningError]) -> None:
    """Its reason goes back to the model; the second answer counts."""
    model = FunctionModel(in_turn(error("too long"), DRIVE))
    outcome = await draft_plan("go", model, SCENE)
    assert outcome.plan == DRIVE
    feedback = model.requests[1].feedback
    assert feedback is not None
    assert feedback.reasons[0].message == "too long"


async def test_a_model_that_is_not_there_is_not_asked_again() -> None:
    """Whoever runs the site must act; the reason says how."""
    model = FunctionModel(in_turn(ModelMissingError("Run `ollama pull llama3.1`.")))
    outcome = await draft_plan("go", model, SCENE)
    assert outcome.attempts == 1
    assert isinstance(outcome.failure, ModelMissingError)
    assert outcome.reasons[0].message == "Run `ollama pull llama3.1`."


async def test_a_server_that_comes_back_is_asked_again() -> None:
    """It may be restarting."""
    model = FunctionModel(in_turn(ServerMissingError("no server"), DRIVE))
    assert (await draft_plan("go", model, SCENE)).plan == DRIVE


async def test_the_schedulers_gate_has_the_last_word() -> None:
    """Its reasons lead to a repair as the own gate's do."""
    said: list[Sequence[Reason]] = [[Reason(code="too_few_robots", message="One is broken.")], []]

    async def accept(_: Plan) -> Sequence[Reason]:
        return said.pop(0)

    model = FunctionModel(lambda _: DRIVE)
    outcome = await draft_plan("go", model, SCENE, accept=accept)
    assert outcome.plan == DRIVE
    feedback = model.requests[1].feedback
    assert feedback is not None
    assert feedback.reasons[0].code == "too_few_robots"


async def test_the_token_cap_ends_planning() -> None:
    """What one mission may cost is bounded, and the reason says so."""
    model = FunctionModel(lambda _: NOWHERE)
    outcome = await draft_plan("go", model, SCENE, limits=Limits(tokens=20))
    assert outcome.attempts == 1
    assert [r.code for r in outcome.reasons] == ["planning_budget", "unknown_object"]


async def test_each_call_gets_what_is_left_of_the_budget() -> None:
    """Time and tokens shrink from call to call."""
    model = FunctionModel(lambda _: NOWHERE)
    await draft_plan("go", model, SCENE, limits=Limits(time_s=50, tokens=100, answer_tokens=90))
    assert [r.max_tokens for r in model.requests] == [90, 80, 60]
    assert model.requests[0].timeout_s == 50
    assert model.requests[1].timeout_s < 50


async def test_tokens_of_failed_answers_count() -> None:
    """A model that rambles to the limit has cost that much."""

    async def ramble(_: PlanRequest) -> PlanDraft:
        raise TruncatedAnswerError("cut", tokens_in=30, tokens_out=30)

    class Rambler:
        async def plan(self, request: PlanRequest) -> PlanDraft:
            return await ramble(request)

    outcome = await draft_plan("go", Rambler(), SCENE, limits=Limits(tokens=100))
    assert (outcome.attempts, outcome.tokens) == (2, 120)


async def test_objects_that_the_map_lacks_are_looked_for_before_and_after_the_model() -> None:
    """First what the words say, then what the plan names; what is found counts."""
    outcome_scene = LookingScene(appear={"rock4", "puddle7"})
    outcome = await draft_plan("drive to rock 4", FunctionModel(lambda _: NOWHERE), outcome_scene)
    assert outcome.plan == NOWHERE
    assert outcome_scene.looked == [["rock4"], ["puddle7"]]


async def test_what_the_words_name_and_nobody_finds_is_refused_without_a_model() -> None:
    """A small model would take the nearest thing that is there."""
    scene, model = LookingScene(appear=set()), FunctionModel(lambda _: DRIVE)
    outcome = await draft_plan("excavator 1 to puddle 7", model, scene)
    assert [r.code for r in outcome.reasons] == ["unknown_object"]
    assert model.requests == []
    assert scene.looked == [["puddle7"]]


class LookingScene:
    """The default site, with cameras that find certain objects."""

    def __init__(self, appear: set[str]) -> None:
        self._there = Surroundings.of_file(YARD)
        self._appear = appear
        self.looked: list[list[str]] = []

    def now(self) -> Surroundings:
        """Return what is there."""
        return self._there

    async def look_for(self, names: Collection[str]) -> None:
        """Find what there is to find."""
        self.looked.append(sorted(names))
        found = sorted({*self._there.objects, *(self._appear & set(names))})
        self._there = Surroundings(
            self._there.roster, tuple(found), self._there.catalogue, self._there.letters, self._there.classes
        )
