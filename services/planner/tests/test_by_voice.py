"""What saved results say about unknown voices, and about more training."""

import importlib.util
import sys
from pathlib import Path
from typing import Any

from muster_planner.evaluation.measures import Answer, Evaluation, summarise


def by_voice() -> Any:
    """Import the module, which is no installed package, under a name of its own."""
    name = "planner_training_by_voice"
    if name not in sys.modules:
        path = Path(__file__).resolve().parents[1] / "training" / "by_voice.py"
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec
        assert spec.loader
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def result(right: dict[str, bool], **labels: str | float) -> Evaluation:
    """Return the result of answers {"voice-number level": right}."""
    answers = [
        Answer(
            id=said.split()[0],
            voice=said.rpartition("-")[0],
            level=said.split()[1],
            repeat=0,
            text="",
            must_refuse=False,
            refused=False,
            right=ok,
            seconds=1,
        )
        for said, ok in right.items()
    ]
    return summarise(
        answers,
        dataset="d",
        planner="embedded",
        method="dart-llm",
        dependencies=True,
        repeat=1,
        complete=True,
        labels=labels,
    )


def test_voices_left_out_are_averaged_over_their_answers() -> None:
    """Each stands for itself, too."""
    module = by_voice()
    rows = module.left_out(
        [
            result({"v7-1 L1": True, "v7-2 L1": True, "v7-3 L3": False}, held_out="voice7"),
            result({"v10-1 L1": False}, held_out="voice10"),
            result({"d1-1 L1": True}, tokens=5),
        ]
    )
    assert list(rows) == ["voice7", "voice10", "mean"]
    assert str(rows["voice7"]["L1"]) == "1.000 (2/2)"
    assert str(rows["mean"]["L1"]) == "0.667 (2/3)"
    assert str(rows["mean"]["L2"]) == "-"


def test_curves_rise_with_their_label(tmp_path: Path) -> None:
    """A run at a time, and drawn as a picture."""
    module = by_voice()
    results = [
        result({"d1-1 L1": True}, run="b", tokens=2e6, voices=60),
        result({"d1-1 L1": False, "d2-1 L1": True}, run="b", tokens=1e6),
        result({"d1-1 L1": True}, run="a", tokens=3e6),
    ]
    assert [(run, value, str(s["L1"])) for run, value, s in module.curve(results, "tokens")] == [
        ("a", 3e6, "1.000 (1/1)"),
        ("b", 1e6, "0.500 (1/2)"),
        ("b", 2e6, "1.000 (1/1)"),
    ]
    told = module.report(results)
    assert "| b 1e+06 | 0.500 (1/2) |" in told
    assert "SR against voices:" in told
    assert "d, by voice:" in told
    module.draw(results, tmp_path / "curves.png")
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")
