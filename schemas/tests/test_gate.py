"""The gate: every reason against a plan, and no reason against a good one."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from muster_schemas.base import Pose
from muster_schemas.gate import check_plan, unknown_objects
from muster_schemas.plan import MAX_TASKS, InstructionFunction, Plan, PlanTask
from muster_schemas.robot import RobotCard
from muster_schemas.skills import PAPER_CATALOGUE, PAPER_SKILLS, Catalogue, Skill

OBJECTS = {"soil1", "puddle1"}
GO = "target_area_for_specific_robots"


def card(robot_id: str, robot_type: str, *skills: str) -> RobotCard:
    """Return a robot's card; without skills it has all that its type can do."""
    able = tuple(s.name for s in PAPER_SKILLS if not s.robot_types or robot_type in s.robot_types)
    return RobotCard(
        robot_id=robot_id,
        boot_id="boot-1",
        type=robot_type,
        skills=skills or able,
        home=Pose(x=0, y=0),
        length_m=3,
        width_m=2,
        max_speed_mps=1,
    )


ROSTER = [card("e1", "excavator"), card("e2", "excavator"), card("t1", "dump_truck")]


def task(name: str = "a", skill: str = GO, **fields: Any) -> PlanTask:
    """Return a task that drives e1 to soil1, changed as the test wants."""
    function: dict[str, Any] = {"name": skill, "robot_ids": ["e1"], "object_keywords": ["soil1"], **fields}
    return PlanTask(task=name, instruction_function=InstructionFunction.model_validate(function))


def reasons(*tasks: PlanTask, roster: list[RobotCard] | None = None) -> list[tuple[str, str | None]]:
    """Return (code, task) of every reason against a plan of these tasks."""
    found = check_plan(Plan(tasks=tasks), ROSTER if roster is None else roster, OBJECTS, PAPER_CATALOGUE)
    assert all(r.message.endswith((".", "...")) or len(r.message) == 1000 for r in found), "a sentence for a person"
    return [(r.code, r.task) for r in found]


GOOD = [
    task(),
    task(robot_ids=["e1", "t1"], object_keywords=["soil1", "puddle1"]),
    task(robot_ids=[], robot_type=["excavator"], robot_count=2),
    task(robot_ids=[], robot_type=["excavator"], robot_count="all"),
    task(robot_ids=[], robot_type=["excavator", "dump_truck"], robot_count=1),
    task(skill="Excavation", object_keywords=[]),
    task(skill="excavator_digging"),
    task(skill="DumpUnloading", robot_ids=["t1"]),
    task(skill="target_area_for_all_robots", robot_ids=[]),
    task(skill="target_area_for_all_robots", robot_ids=["e1", "e2", "t1"]),
    task(skill="return_to_start_for_specific_robots", object_keywords=[]),
]


@pytest.mark.parametrize("good", GOOD, ids=lambda t: t.instruction_function.name)
def test_a_good_task_passes(good: PlanTask) -> None:
    """Nothing is held against what the site can do."""
    assert reasons(good) == []


BAD = {
    "unknown_skill": task(skill="fly"),
    "object_missing": task(object_keywords=[]),
    "object_unwanted": task(skill="return_to_start_for_specific_robots"),
    "invalid_object": task(object_keywords=["../soil"]),
    "unknown_object": task(object_keywords=["soil9"]),
    "not_all_robots": task(skill="target_area_for_all_robots", robot_ids=["e1"]),
    "robot_missing": task(robot_ids=[]),
    "repeated_robot": task(robot_ids=["e1", "e1"]),
    "unknown_robot": task(robot_ids=["e9"]),
    "wrong_type": task(skill="Excavation", robot_ids=["t1"]),
    "unknown_type": task(robot_ids=[], robot_type=["crane"]),
    "too_few_robots": task(robot_ids=[], robot_type=["excavator"], robot_count=3),
    "unknown_dependency": task(dependencies=["b"]),
}


@pytest.mark.parametrize("code", BAD)
def test_a_bad_task_is_refused_for_its_reason(code: str) -> None:
    """Each fault of a task has one reason that names the task."""
    assert reasons(BAD[code]) == [(code, "a")]


def test_a_plan_without_tasks_is_refused() -> None:
    """Nothing to do is no plan."""
    assert reasons() == [("empty_plan", None)]


def test_too_many_tasks_are_refused() -> None:
    """The gate has the limit too, for plans that were not parsed."""
    plan = Plan.model_construct(tasks=(task(),) * (MAX_TASKS + 1))
    assert [r.code for r in check_plan(plan, ROSTER, OBJECTS, PAPER_CATALOGUE)] == ["too_many_tasks"]


def test_two_tasks_of_one_name_are_refused() -> None:
    """A dependency must mean one task."""
    assert reasons(task("a"), task("a")) == [("repeated_name", "a")]


def test_a_circle_is_refused_and_shown() -> None:
    """Tasks that wait for each other would wait for ever."""
    plan = Plan(tasks=(task("a", dependencies=["c"]), task("b", dependencies=["a"]), task("c", dependencies=["b"])))
    (reason,) = check_plan(plan, ROSTER, OBJECTS, PAPER_CATALOGUE)
    assert reason.code == "cycle"
    assert all(name in reason.message for name in "abc")
    assert reasons(task("a", dependencies=["a"])) == [("cycle", None)]


def test_all_reasons_are_told_at_once() -> None:
    """Whoever repairs a plan learns everything that is wrong with it."""
    assert set(reasons(task("a", skill="fly"), task("b", robot_ids=["e9"], object_keywords=["soil9"]))) == {
        ("unknown_skill", "a"),
        ("unknown_robot", "b"),
        ("unknown_object", "b"),
    }


def test_a_robot_that_lacks_the_skill_is_refused_whatever_its_type() -> None:
    """A robot's card says what it can do; a broken bucket is not in it."""
    roster = [card("e1", "excavator", GO)]
    assert reasons(task(skill="Excavation"), roster=roster) == [("wrong_type", "a")]
    counted = task(skill="Excavation", robot_ids=[], robot_type=["excavator"], robot_count=1)
    assert reasons(counted, roster=roster) == [("wrong_type", "a")]


def test_an_empty_site_refuses_everything() -> None:
    """Without robots every named robot and type is unknown."""
    assert reasons(task(), roster=[]) == [("unknown_robot", "a")]


def test_skills_of_the_sites_own_robots_pass() -> None:
    """A new robot type needs its entry in the site's file, nothing here."""
    sweep = Skill(name="sweep_yard", verb="sweep", text="sweep", robot_types=("sweeper",))
    roster = [card("s1", "sweeper", "sweep_yard")]
    plan = Plan(tasks=(task(skill="sweep_yard", robot_ids=["s1"]),))
    assert check_plan(plan, roster, OBJECTS, Catalogue.with_site([sweep])) == []


def test_objects_to_look_for_are_those_that_the_map_lacks() -> None:
    """The cameras are asked only for what the plan names and nobody has seen."""
    plan = Plan(tasks=(task("a", object_keywords=["soil9", "soil1"]), task("b", object_keywords=["rock7"])))
    found = check_plan(plan, ROSTER, OBJECTS, PAPER_CATALOGUE)
    assert unknown_objects(found, plan, OBJECTS) == ["rock7", "soil9"]
    assert unknown_objects([], plan, OBJECTS) == []


NAMES = st.sampled_from(["a", "b", "c", "e1", "e9", "soil1", "excavator", "crane", "*", "x" * 64])
FUNCTIONS = st.builds(
    InstructionFunction,
    name=st.sampled_from(["Excavation", GO, "target_area_for_all_robots", "fly", "x" * 64]),
    robot_ids=st.lists(NAMES, max_size=3).map(tuple),
    robot_type=st.lists(NAMES, max_size=2).map(tuple),
    robot_count=st.sampled_from([None, 1, 3, 10_000, "all"]),
    dependencies=st.lists(NAMES, max_size=3).map(tuple),
    object_keywords=st.lists(NAMES, max_size=3).map(tuple),
)


@given(st.lists(st.builds(PlanTask, task=NAMES, instruction_function=FUNCTIONS), max_size=6))
def test_the_gate_has_an_answer_to_every_plan(tasks: list[PlanTask]) -> None:
    """Whatever parses gets a list of reasons, never an error; and the same plan the same reasons."""
    plan = Plan(tasks=tuple(tasks))
    once = check_plan(plan, ROSTER, OBJECTS, PAPER_CATALOGUE)
    assert once == check_plan(plan, ROSTER, OBJECTS, PAPER_CATALOGUE)
    assert bool(once) or bool(tasks)
