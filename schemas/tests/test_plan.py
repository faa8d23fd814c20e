"""The published plan form, as the data set and language models write it."""

import json

import pytest
from muster_schemas.examples import PLAN
from muster_schemas.plan import MAX_TASKS, Plan
from pydantic import ValidationError


def task(**fields: object) -> dict[str, object]:
    """Return a task as the data set has it."""
    return {"task": "t", "instruction_function": {"name": "Excavation", "robot_ids": ["r"]}, **fields}


def read(*tasks: dict[str, object]) -> Plan:
    """Return the plan of these tasks."""
    return Plan.model_validate_json(json.dumps({"tasks": tasks}))


def test_objects_may_stand_beside_the_function() -> None:
    """The data set has `object_keywords` in both places; both are read, and one is written."""
    plan = read(task(object_keywords=["soil1"]))
    assert plan.tasks[0].instruction_function.object_keywords == ("soil1",)
    assert plan.model_dump()["tasks"][0]["instruction_function"]["object_keywords"] == ("soil1",)
    assert "object_keywords" not in plan.model_dump()["tasks"][0]


def test_objects_in_the_function_win() -> None:
    """Where both places say something, the function's own counts."""
    function = {"name": "Excavation", "robot_ids": ["r"], "object_keywords": ["rock1"]}
    assert read(task(instruction_function=function, object_keywords=["soil1"])).tasks[
        0
    ].instruction_function.object_keywords == ("rock1",)


def test_a_single_name_needs_no_brackets_and_null_means_none() -> None:
    """The data set's looser spellings are read."""
    function = {"name": "Excavation", "robot_type": "excavator", "robot_ids": None, "dependencies": None}
    plan = read(task(instruction_function=function, object_keywords="soil1"))
    parsed = plan.tasks[0].instruction_function
    assert (parsed.robot_type, parsed.robot_ids, parsed.dependencies) == (("excavator",), (), ())
    assert parsed.object_keywords == ("soil1",)


@pytest.mark.parametrize(
    ("alias", "name"),
    [
        ("Excavation", "excavator_digging"),
        ("FE1", "excavator_digging"),
        ("ExcavatorUnloading", "excavator_unloading"),
        ("DumpLoading", "dump_loading"),
        ("DumpUnloading", "dump_unloading"),
        ("excavator_digging", "excavator_digging"),
        ("no_such_skill", "no_such_skill"),
    ],
)
def test_a_skill_has_one_name_in_keys(alias: str, name: str) -> None:
    """Aliases stand for the paper's name; an unknown one stays, for the gate to refuse."""
    function = {"name": alias, "robot_ids": ["r"]}
    assert read(task(instruction_function=function)).tasks[0].instruction_function.skill == name


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"task": ""},
        {"task": "x" * 65},
        {"instruction_function": None},
        {"instruction_function": {"name": "", "robot_ids": ["r"]}},
        {"instruction_function": {"name": "Excavation", "robot_count": 0}},
        {"instruction_function": {"name": "Excavation", "robot_count": "some"}},
        {"instruction_function": {"name": "Excavation", "robot_ids": [1]}},
        {"instruction_function": {"name": "Excavation", "robot_ids": [["r"]]}},
    ],
)
def test_what_is_no_task_is_refused(wrong: dict[str, object]) -> None:
    """A task that breaks the form does not parse."""
    with pytest.raises(ValidationError):
        read({**task(), **wrong} if wrong else {})


def test_more_tasks_than_allowed_do_not_parse() -> None:
    """A runaway model's answer ends at the edge."""
    read(*(task() for _ in range(MAX_TASKS)))
    with pytest.raises(ValidationError):
        read(*(task() for _ in range(MAX_TASKS + 1)))


def test_a_plan_survives_its_json() -> None:
    """Written and read again, a plan is the same."""
    assert Plan.model_validate_json(PLAN.to_json()) == PLAN
