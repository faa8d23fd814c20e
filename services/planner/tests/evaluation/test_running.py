"""From a data set and a planner to scored answers."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from muster_planner.errors import ModelTimeoutError, ServerMissingError
from muster_planner.evaluation.cases import Case
from muster_planner.evaluation.running import Judge, chosen
from muster_planner.evaluation.testing import THERE, case_of, plan
from muster_planner.offline import PlannedLine

GO = replace(case_of("a go E1 @ soil1", "b go T1 @ puddle1 < a"), id="go", level="L2", text="first E1, then T1")
HOIST = Case("hoist", "L1", "hoist the crane", refuse="there is no crane")
RIGHT = plan("a go E1 @ soil1", "b go T1 @ puddle1 < a")


class Said:
    """A planner that says what it was given, in order."""

    def __init__(self, *lines: PlannedLine) -> None:
        self._lines: Iterator[PlannedLine] = iter(lines)

    def plan(self, text: str, *, id: str = "") -> PlannedLine:  # noqa: A002 (as in the files)
        """Return the next line."""
        assert text
        return replace(next(self._lines), id=id)


def test_every_case_is_asked_and_scored_as_often_as_wished() -> None:
    """All cases, then all again."""
    line = PlannedLine("", RIGHT, 0.5, None)
    refused = PlannedLine("", None, 0.1, "There is no crane.")
    answers = list(Judge(THERE).answers([GO, HOIST], Said(line, refused, line, line), repeat=2))
    assert [(a.id, a.repeat, a.right, a.refused) for a in answers] == [
        ("go", 0, True, False),
        ("hoist", 0, True, True),
        ("go", 1, True, False),
        ("hoist", 1, False, False),
    ]
    assert answers[3].why == "must be refused"
    assert answers[3].plan
    assert answers[0].plan is None


def test_without_dependencies_other_robots_are_not_waited_for() -> None:
    """The plan is judged as its robots' queues; as a list its order is kept."""
    line = PlannedLine("", RIGHT, 0.5, None)
    [answer] = Judge(THERE).answers([GO], Said(line))
    assert (answer.right, answer.queues, answer.listed, answer.listed_in_order) == (True, 0, 1, 1)
    [dropped] = Judge(THERE, dependencies=False).answers([GO], Said(line))
    assert (dropped.right, dropped.queues) == (False, 0)


def test_a_good_instruction_refused_is_told_from_a_model_that_failed() -> None:
    """Only the first is a refusal; neither is right."""
    late = PlannedLine("", None, 60.0, "too late", failure=ModelTimeoutError("too late"))
    refused, failed = Judge(THERE).answers([GO, GO], Said(PlannedLine("", None, 0.1, "no"), late))
    assert (refused.refused, refused.right, refused.why) == (True, False, "refused")
    assert (failed.refused, failed.right, failed.why) == (False, False, "no plan")
    [not_answered] = Judge(THERE).answers([HOIST], Said(late))
    assert not not_answered.right


def test_a_model_that_is_not_there_ends_the_evaluation() -> None:
    """Its zeros would say nothing about plans."""
    gone = PlannedLine("", None, 0.1, "no server", failure=ServerMissingError("no server"))
    with pytest.raises(ServerMissingError):
        list(Judge(THERE).answers([GO], Said(gone)))


def test_a_limit_draws_the_same_cases_each_time() -> None:
    """In the order of the file."""
    cases = [replace(GO, id=str(n)) for n in range(50)]
    drawn = [c.id for c in chosen(cases, 10)]
    assert drawn == [c.id for c in chosen(cases, 10)]
    assert len(set(drawn)) == 10
    assert drawn == sorted(drawn, key=int)
    assert chosen(cases, None) == chosen(cases, 99) == cases
