"""New plans for the rest of a mission."""

from muster_bus.testing import RouterProcess
from muster_planner.replanning import background, rest_in_words
from muster_planner.testing import DRIVE, YARD, FunctionModel, running_planner
from muster_schemas.channels import REPLAN
from muster_schemas.plan import Plan
from muster_schemas.rpc import ReplanMission, ReplanReply


def question() -> ReplanMission:
    """Return the question about a dig that failed, with a drive and an unloading after it, written backwards."""
    tasks = Plan.model_validate(
        {
            "tasks": [
                {"task": "go", "instruction_function": {"name": "target_area_for_specific_robots",
                 "robot_ids": ["robot_excavator_01"], "object_keywords": ["soil1"]}},
                {"task": "dig", "instruction_function": {"name": "Excavation", "robot_ids": ["robot_excavator_01"],
                 "dependencies": ["go"], "object_keywords": ["soil1"]}},
                {"task": "dump", "instruction_function": {"name": "ExcavatorUnloading",
                 "robot_ids": ["robot_excavator_01"], "dependencies": ["come"]}},
                {"task": "come", "instruction_function": {"name": "target_area_for_specific_robots",
                 "robot_type": ["dump_truck"], "robot_count": 2, "dependencies": ["dig"],
                 "object_keywords": ["puddle1"]}},
            ]
        }
    ).tasks  # fmt: skip
    return ReplanMission(
        mission_id="m-1",
        task_id="t2",
        number=1,
        text="Dig it.",
        done=tasks[:1],
        failed=tasks[1],
        error="robot_excavator_01: nothing to dig",
        rest=tasks[2:],
    )


def test_the_rest_is_said_in_the_order_of_its_dependencies() -> None:
    """A robot that is there keeps its name; one that has gone becomes any of its type."""
    roster = [YARD.card(r.id, "b") for r in YARD.robots]
    text = rest_in_words(question(), roster, YARD.catalogue)
    assert text == (
        "excavator 1 digs at soil 1, then 2 dump trucks go to puddle 1, then excavator 1 unloads."
    )  # fmt: skip
    without = [c for c in roster if c.robot_id != "robot_excavator_01"]
    assert rest_in_words(question(), without, YARD.catalogue).startswith("one excavator digs at soil 1")


def test_a_large_model_is_told_what_was_done_and_what_failed() -> None:
    """Beside the words of the rest."""
    said = background(question())
    for part in ("Dig it.", "Already done: go", "Failed: dig", "nothing to dig"):
        assert part in said


async def test_the_planner_answers_with_a_plan_that_passed_the_gate(shared_router: RouterProcess) -> None:
    """Over the bus, by the same way as an instruction; what cannot be planned is told with reasons."""
    answers = iter((DRIVE, "That is impossible."))
    model = FunctionModel(lambda _: next(answers))
    async with running_planner(shared_router, model) as planner:
        reply: ReplanReply = await planner.bus.ask(REPLAN, question(), timeout_s=60)
        assert reply.plan == DRIVE
        reply = await planner.bus.ask(REPLAN, question().model_copy(update={"number": 2}), timeout_s=60)
    assert reply.plan is None
    assert [r.message for r in reply.reasons] == ["That is impossible."]
    assert "nothing to dig" in (model.requests[0].background or "")
