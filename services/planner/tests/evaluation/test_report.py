"""Evaluations as text and picture."""

from pathlib import Path

from muster_planner.evaluation import picture, report
from muster_planner.evaluation.measures import Answer, summarise

WRONG = Answer(
    id="x-1", level="L3", repeat=0, text="dig | haul", must_refuse=False, refused=False, right=False, ipa=0.5,
    why="steps differ (50% right)", diff=("- dig robot_excavator_01",), error="cut off", seconds=2.0,
)  # fmt: skip
RIGHT = Answer(
    id="x-2", level="L1", repeat=1, text="go", must_refuse=False, refused=False, right=True, ipa=1, dsr=1, sgsr=1,
    seconds=1.0, queues=1,
)  # fmt: skip
RESULT = summarise(
    [WRONG, RIGHT],
    dataset="d.jsonl",
    planner="embedded",
    method="smart-llm",
    dependencies=False,
    repeat=2,
    limit=9,
    complete=False,
)


def test_the_page_holds_both_tables_and_what_the_paper_reports() -> None:
    """And says how it was made."""
    page = report.markdown(RESULT)
    assert (
        "d.jsonl, planner embedded, smart-llm, without dependencies (queues), 9 cases drawn by chance, 2 repeats"
        in page
    )
    assert "| L1 | 1 | 1.000 ± 0.000 | 1.000 | 1.000 | 1.000 | 1.00 | 1.00 | 0.00 |" in page
    assert "| L3 | 0.000 | 0.000 | 0.000 | 0.000 |" in page
    assert "| DART-LLM (DeepSeek-r1) | 1.00 | 1.00 | 1.00 | 1.00 | 0.30 | 0.97 |" in page
    assert "stopped before its last case" in page
    assert page.rstrip().endswith("Wrong: x-1.")


def test_a_failure_is_told_with_its_diff() -> None:
    """What was said, what is missing, and the model's error."""
    told = report.failure(WRONG)
    assert told.splitlines() == [
        "x-1: steps differ (50% right)",
        "    dig | haul",
        "    - dig robot_excavator_01",
        "    said: cut off",
    ]


def test_the_picture_is_the_same_for_the_same_numbers(tmp_path: Path) -> None:
    """So that a picture in the repository changes only with what it shows."""
    picture.draw(RESULT, tmp_path / "one.png")
    picture.draw(RESULT, tmp_path / "two.png")
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert (tmp_path / "one.png").read_bytes().startswith(b"\x89PNG")
