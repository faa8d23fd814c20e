"""Planning without services: a site's file, a model, and lines in and out."""

import json
from collections.abc import Generator
from pathlib import Path

import pytest
from muster_planner.errors import UnknownPlannerError
from muster_planner.offline import open_offline, plan_batch, plan_one
from muster_planner.published import published_form
from muster_planner.testing import DRIVE, YARD, lines_of
from muster_planner.testing_servers import ModelServer, fails, model_server, says

PLANNER = "ollama:llama3.1"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Generator[ModelServer]:
    """Provide an Ollama server where `OLLAMA_HOST` says."""
    with model_server() as running:
        monkeypatch.setenv("OLLAMA_HOST", running.url)
        yield running


def test_one_instruction_gives_one_plan(server: ModelServer) -> None:
    """Robots and objects are those of the site's file."""
    server.answers = [says(published_form(DRIVE))]
    line = plan_one("go to the soil", site=YARD, planner=PLANNER)
    assert (line.plan, line.error) == (DRIVE, None)
    assert line.latency_s > 0
    assert all(r.id in server.requests[0]["messages"][0]["content"] for r in YARD.robots)


def test_an_instruction_without_a_plan_has_an_error_in_words(server: ModelServer) -> None:
    """The refusal, the model's failure, or what is wrong with the text."""
    server.answers = [says({"refusal": "There is no crane."}), fails(404, "model not found")]
    with open_offline(YARD, PLANNER) as offline:
        assert offline.plan("hoist").error == "There is no crane."
        assert "ollama pull" in (offline.plan("hoist").error or "")
        assert "empty" in (offline.plan(" \n").error or "")
        assert "2000" in (offline.plan("x" * 2001).error or "")


def test_a_batch_answers_each_line(server: ModelServer, tmp_path: Path) -> None:
    """In order, in the published form, with progress; bad lines give error lines and stop nothing."""
    server.answers = [says(published_form(DRIVE))]
    source, target = tmp_path / "in.jsonl", tmp_path / "out.jsonl"
    source.write_bytes(
        b'{"id": "a", "text": "go"}\n'
        b"\n"
        b"no json\n"
        b'{"id": "b"}\n'
        b'{"id": 7, "text": "go"}\n'
        b'["c", "go"]\n'
        b'{"id": "d", "text": "\xff"}\n'
        b'{"id": "e", "text": "  "}\n' + b'{"id": "f", "text": "' + b"x" * 70_000 + b'"}\n'
        b'{"id": "g", "text": "go"}'
    )
    seen: list[tuple[int, int]] = []
    summary = plan_batch(source, target, site=YARD, planner=PLANNER, progress=lambda n, of: seen.append((n, of)))
    lines = lines_of(target)
    assert [line["id"] for line in lines] == ["a", "line-2", "b", "7", "line-5", "line-6", "e", "line-8", "g"]
    assert [line["plan"] is not None for line in lines] == [True, False, False, True, False, False, False, False, True]
    assert all((line["plan"] is None) == (line["error"] is not None) for line in lines)
    assert lines[0]["plan"] == published_form(DRIVE)
    assert all(set(line) == {"id", "plan", "latency_s", "error"} for line in lines)
    assert (summary.lines, summary.planned) == (9, 3)
    assert seen == [(n, 9) for n in range(1, 10)]


def test_an_empty_batch_gives_an_empty_file(server: ModelServer, tmp_path: Path) -> None:
    """And asks no model."""
    (tmp_path / "in.jsonl").write_text("\n")
    plan_batch(tmp_path / "in.jsonl", tmp_path / "out.jsonl", site=YARD, planner=PLANNER)
    assert (tmp_path / "out.jsonl").read_text() == ""
    assert server.requests == []


def test_ids_come_back_as_they_are(server: ModelServer, tmp_path: Path) -> None:
    """Also those that are no ASCII."""
    server.answers = [says(published_form(DRIVE))]
    (tmp_path / "in.jsonl").write_text(json.dumps({"id": "größe 1/\u2028", "text": "go"}))
    plan_batch(tmp_path / "in.jsonl", tmp_path / "out.jsonl", site=YARD, planner=PLANNER)
    assert lines_of(tmp_path / "out.jsonl")[0]["id"] == "größe 1/\u2028"


def test_an_unknown_planner_is_said_so() -> None:
    """With what there is."""
    with pytest.raises(UnknownPlannerError, match=r"ollama:llama3\.1"):
        plan_one("go", site=YARD, planner="gpt")
