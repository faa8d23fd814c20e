"""Which plans are right for a case, and how wrong the others are."""

from dataclasses import replace

import pytest
from muster_planner.evaluation.cases import Case, Wanted
from muster_planner.evaluation.scoring import score
from muster_planner.evaluation.testing import FLEET, THERE, case_of, plan, scored
from muster_schemas.plan import Plan

HAUL = ("a go E1 T1 @ soil1", "b dig E1 @ soil1 < a", "c dump E1 @ soil1 < b", "d go T1 @ puddle1 < c")
"""A pair drives to the pile, the excavator digs and unloads, the truck leaves."""

TWO = ("a go E1 @ soil1", "b go T1 @ puddle1")
"""Two robots that have nothing to do with each other."""


def test_the_reference_itself_is_right() -> None:
    """In every measure."""
    result = scored(case_of(*HAUL), *HAUL)
    assert (result.sr, result.ipa, result.dsr, result.sgsr, result.why, result.diff) == (1, 1, 1, 1, "", ())


@pytest.mark.parametrize(
    ("reference", "said"),
    [
        pytest.param(
            HAUL,
            ("a go E1 @ soil1", "b go T1 @ soil1", "c dig E1 < a", "d dump E1 < b c", "e go T1 @ puddle1 < d"),
            id="one task a robot, places of work left out, the truck waited for later",
        ),
        pytest.param(("a go all @ soil1",), ("a go E* T* @ soil1",), id="the fleet by its types"),
        pytest.param(("a go all @ soil1",), ("a go E1 E2 E3 T1 T2 T3 @ soil1",), id="the fleet by its ids"),
        pytest.param(("a home T*",), ("a home T1 T2", "b home T3"), id="a type by its ids, in two tasks"),
        pytest.param(
            ("a avoid all @ puddle1 puddle2",), ("a avoid all @ puddle1", "b avoid all @ puddle2"), id="rules"
        ),
        pytest.param(("a go E1 @ soil1", "b go T1 @ soil1"), ("a go E1 T1 @ soil1",), id="two tasks as a joint one"),
        pytest.param(("a go E1 @ soil1", "b dig E1 < a"), ("a go E1 @ soil1", "b dig E1 @ soil1 < a"), id="the place"),
        pytest.param(
            ("a go E1 @ soil1", "b dig E1 < a", "c home E1 < b"),
            ("a go E1 @ soil1", "b dig E1 < a", "c home E1 < a b"),
            id="a dependency that another implies",
        ),
    ],
)
def test_plans_that_mean_the_same_are_right(reference: tuple[str, ...], said: tuple[str, ...]) -> None:
    """However they are said."""
    assert scored(case_of(*reference), *said).right


@pytest.mark.parametrize(
    ("reference", "said", "why"),
    [
        pytest.param(TWO, ("a go E1 @ soil1", "b go T1 @ puddle2"), "steps differ (50% right)", id="another object"),
        pytest.param(TWO, ("a go E1 @ soil1",), "steps differ (50% right)", id="a robot forgotten"),
        pytest.param(TWO, (*TWO, "c home E1 < a"), "1 too many", id="a step that nobody asked for"),
        pytest.param(TWO, ("a go E1 @ soil1", "b go T1 @ puddle1 < a"), "order 0%", id="parallel work chained"),
        pytest.param(HAUL, (*HAUL[:3], "d go T1 @ puddle1 < a"), "order 67%", id="the truck leaves too early"),
        pytest.param(("a dig E1",), ("a dig E1 @ soil1",), "steps differ (0% right)", id="an invented place"),
        pytest.param(
            ("a go T1 @ soil1", "b go T1 @ rock1 < a", "c tip T1 < b"),
            ("a go T1 @ soil1", "b go T1 @ rock1 < a", "c tip T1 @ soil1 < b"),
            "steps differ (67% right)",
            id="a place that the robot has left",
        ),
        pytest.param(("a home T:2",), ("a home T1 T2",), "steps differ (0% right)", id="any two are no two by name"),
    ],
)
def test_plans_that_mean_something_else_are_wrong(reference: tuple[str, ...], said: tuple[str, ...], why: str) -> None:
    """And it is said what is wrong."""
    result = scored(case_of(*reference), *said)
    assert (result.sr, result.why) == (0.0, why)
    assert result.diff


def test_the_diff_names_what_is_missing_and_what_is_too_much() -> None:
    """One line each."""
    result = scored(case_of(*TWO), "a go E1 @ soil1", "b go T2 @ puddle1")
    assert result.diff == ("- go robot_dump_truck_01 @ puddle1", "+ go robot_dump_truck_02 @ puddle1")
    assert result.ipa == 0.5
    chained = scored(case_of(*TWO), "a go E1 @ soil1", "b go T1 @ puddle1 < a")
    assert chained.diff == (
        "~ go robot_excavator_01 @ soil1 and go robot_dump_truck_01 @ puddle1 must not wait for each other",
    )


def test_what_is_no_plan_scores_nothing() -> None:
    """None, a cycle, two tasks of one name."""
    twice = plan("a go E1 @ soil1", "b home E1")
    same_name = Plan(tasks=(twice.tasks[0], twice.tasks[1].model_copy(update={"task": twice.tasks[0].task})))
    for broken in (None, plan("a go E1 @ soil1 < b", "b home E1 < a"), same_name):
        result = score(case_of(*TWO), broken, FLEET, THERE.catalogue)
        assert (result.sr, result.ipa, result.dsr, result.sgsr) == (0, 0, 0, 0)
        assert result.why


def test_alternatives_and_optional_tasks_are_as_good() -> None:
    """Where a case allows several ways to say who, or a task that may be there."""
    go = Wanted("a", frozenset({"go"}), (("robot_excavator_01",), ("robot_excavator_02",)), (("soil1",), ("soil2",)))
    home = Wanted("b", frozenset({"home"}), (("robot_excavator_01",),), ((),), optional=True)
    case = Case("x", "L1", "text", wanted=(go, home), before=(("a", "b"),))
    assert scored(case, "a go E1 @ soil2").right
    assert scored(case, "a go E2 @ soil1").right
    assert scored(case, "a go E1 @ soil1", "b home E1 < a").right
    assert not scored(case, "a go E1 @ soil1", "b home E1").right
    assert not scored(case, "a go E3 @ soil1").right


def test_one_robots_two_tasks_may_stand_in_any_order_that_the_case_leaves_open() -> None:
    """A robot does one thing at a time, so parallelism is asked of different robots only."""
    case = case_of("a go E1 @ soil1", "b go E1 @ rock1", "c home T1")
    assert scored(case, "a go E1 @ rock1", "b go E1 @ soil1 < a", "c home T1").right
    assert not scored(case, "a go E1 @ rock1", "b go E1 @ soil1 < a", "c home T1 < a").right


def test_without_pairs_to_keep_apart_only_the_order_counts() -> None:
    """Which is how the ablation's list is judged."""
    chained = ("a go E1 @ soil1", "b go T1 @ puddle1 < a")
    assert not scored(case_of(*TWO), *chained).right
    assert scored(replace(case_of(*TWO), unordered=()), *chained).right


def test_a_large_plan_of_equal_parts_is_scored_in_bounded_time() -> None:
    """The search among the ways to match them ends."""
    lines = [f"{chr(97 + n)} dig E{n % 3 + 1} @ soil1" for n in range(24)]
    assert scored(case_of(*lines), *lines[:-1], "x go E1 @ soil1").sr == 0.0
