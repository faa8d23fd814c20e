"""A whole evaluation, from a file to its numbers."""

import json
from collections.abc import Generator
from pathlib import Path

import pytest
from muster_planner.evaluation.evaluating import Asked, evaluate
from muster_planner.published import published_form
from muster_planner.testing import DRIVE, YARD
from muster_planner.testing_servers import ModelServer, model_server, says

PLANNER = "ollama:llama3.1"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Generator[ModelServer]:
    """Provide an Ollama server where `OLLAMA_HOST` says."""
    with model_server() as running:
        monkeypatch.setenv("OLLAMA_HOST", running.url)
        yield running


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """Provide a data set of two equal instructions."""
    path = tmp_path / "set.jsonl"
    lines = ({"ID": f"x-L1-{n}", "text": "E1 to the soil", "output": published_form(DRIVE)} for n in range(2))
    path.write_text("\n".join(json.dumps(line) for line in lines))
    return path


def test_every_answer_is_told_as_it_comes(server: ModelServer, dataset: Path) -> None:
    """With how many are right so far."""
    server.answers = [says({"refusal": "no"}), says(published_form(DRIVE))]
    told: list[tuple[int, int, int]] = []

    def progress(right: int, done: int, total: int) -> None:
        told.append((right, done, total))

    result = evaluate(Asked(dataset, YARD, PLANNER, repeat=2), progress)
    assert told == [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 4, 4)]
    assert result
    assert (result.complete, result.rows[0].sr, result.rows[0].sr_spread) == (True, 0.75, 0.25)


def test_what_was_answered_before_an_interruption_is_kept(server: ModelServer, dataset: Path) -> None:
    """As an evaluation that says that it is not complete."""
    server.answers = [says(published_form(DRIVE))]

    def interrupt(*_: int) -> None:
        raise KeyboardInterrupt

    result = evaluate(Asked(dataset, YARD, PLANNER), interrupt)
    assert result
    assert (result.complete, len(result.answers)) == (False, 1)
