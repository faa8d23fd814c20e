"""From answers to the numbers of the table."""

import pytest
from muster_planner.evaluation.measures import Answer, Evaluation, quantile, reliability, summarise


def answer(id: str, level: str, *, right: bool, seconds: float = 1.0, repeat: int = 0, **fields: object) -> Answer:  # noqa: A002
    """Return an answer with what matters here."""
    said = {"must_refuse": False, "refused": False, "text": "", "ipa": float(right), "dsr": 1.0, "sgsr": 1.0} | fields
    return Answer.model_validate(
        {"id": id, "level": level, "repeat": repeat, "right": right, "seconds": seconds, **said}
    )


def summary(*answers: Answer, repeat: int = 1) -> Evaluation:
    """Return their evaluation."""
    return summarise(
        answers, dataset="d", planner="p", method="dart-llm", dependencies=True, repeat=repeat, complete=True
    )


def test_each_level_has_its_own_means_and_all_have_theirs() -> None:
    """Instructions to refuse count in none of them."""
    result = summary(
        answer("a", "L1", right=True),
        answer("b", "L2", right=True),
        answer("c", "L2", right=False, ipa=0.5),
        answer("d", "L1", right=False, must_refuse=True),
    )
    assert [(r.level, r.cases, r.sr, r.ipa) for r in result.rows] == [
        ("L1", 1, 1.0, 1.0),
        ("L2", 2, 0.5, 0.75),
        ("all", 3, pytest.approx(2 / 3), pytest.approx(2.5 / 3)),
    ]


def test_refusals_are_counted_apart() -> None:
    """Those that must be, and good instructions that were."""
    result = summary(
        answer("a", "L1", right=True, must_refuse=True, refused=True),
        answer("b", "L1", right=False, must_refuse=True),
        answer("c", "L1", right=False, refused=True),
        answer("d", "L1", right=True),
    )
    r = result.refusals
    assert (r.to_refuse, r.rightly_refused, r.good, r.wrongly_refused) == (2, 1, 2, 1)


def test_repeats_give_a_mean_and_a_spread() -> None:
    """The spread is the standard deviation of SR from one repeat to the next; a case counts once."""
    result = summary(
        answer("a", "L1", right=True),
        answer("b", "L1", right=True),
        answer("a", "L1", right=False, repeat=1),
        answer("b", "L1", right=True, repeat=1),
        repeat=2,
    )
    assert (result.rows[0].cases, result.rows[0].sr, result.rows[0].sr_spread) == (2, 0.75, 0.25)
    assert [a.id for a in result.failures] == ["a"]


def test_response_times_are_reliable_when_they_do_not_scatter() -> None:
    """RTR is mean / (mean + standard deviation)."""
    assert reliability([2.0, 2.0, 2.0]) == 1.0
    assert reliability([1.0, 3.0]) == pytest.approx(2 / 3)
    assert reliability([0.0]) == 1.0


def test_quantiles_are_times_that_were_seen() -> None:
    """Of 20 values, 19 do not exceed the 95th percentile."""
    values = [float(n) for n in range(1, 21)]
    assert quantile(values, 0.95) == 19.0
    assert quantile(values, 0.5) == 10.0
    assert quantile([3.0], 0.95) == 3.0


def test_only_refusals_give_no_rows() -> None:
    """There is no level to speak of."""
    assert summary(answer("a", "L1", right=True, must_refuse=True, refused=True)).rows == ()


def test_a_result_file_comes_back_as_it_was_written() -> None:
    """As JSON."""
    result = summary(answer("a", "L1", right=False, plan={"tasks": []}))
    assert Evaluation.model_validate_json(result.model_dump_json()) == result
