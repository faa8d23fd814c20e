"""How measured numbers are collected."""

from collections.abc import Mapping
from typing import Any

import pytest

from benchmarks.__main__ import measures, run

GOOD: dict[str, Any] = {"name": "plan_p95_s", "value": 1.5, "unit": "s", "bar": 2, "ok": True}


def test_one_row_and_several_are_taken() -> None:
    """`measure()` may return a mapping or some of them."""
    assert [r.model_dump() for r in run("one", lambda: GOOD)] == [GOOD]
    assert len(run("two", lambda: [GOOD, GOOD])) == 2


def test_what_cannot_run_is_a_row_that_is_not_ok(capsys: pytest.CaptureFixture[str]) -> None:
    """The error stands in the row, and the other benchmarks still run."""

    def broken() -> Mapping[str, Any]:
        raise RuntimeError("no such model")

    [row] = run("planning", broken)
    assert (row.name, row.value, row.ok) == ("planning", None, False)
    assert "no such model" in str(row.model_extra)
    assert "no such model" in capsys.readouterr().err


def test_a_row_without_a_verdict_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    """A benchmark that forgets `ok` does not pass."""
    [row] = run("planning", lambda: {k: v for k, v in GOOD.items() if k != "ok"})
    assert not row.ok
    assert "ok" in capsys.readouterr().err


def test_an_unknown_benchmark_is_named() -> None:
    """Asking for one that does not exist lists those that do."""
    with pytest.raises(SystemExit, match="nothing-of-it"):
        measures(["nothing-of-it"])
