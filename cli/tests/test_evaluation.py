"""`muster evaluate`: a data set in, tables and files out."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from muster_planner.published import published_form
from muster_planner.testing import DRIVE
from muster_planner.testing_servers import ModelServer, model_server, says

CASE: dict[str, Any] = {"ID": "dart_llm-L1-T1-001", "text": "E1 to the soil", "output": published_form(DRIVE)}
HOIST = {"ID": "x-L1", "text": "hoist the crane", "refuse": "there is no crane"}


def muster(tmp_path: Path, dataset: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run `muster evaluate` with a data set of two lines."""
    (tmp_path / "set.jsonl").write_text("\n".join(json.dumps(line) for line in (CASE, HOIST)))
    env = {"MUSTER_DATA_DIR": str(tmp_path / "data"), "COLUMNS": "120", **environment}
    return subprocess.run(
        [sys.executable, "-m", "muster_cli", "evaluate", str(tmp_path / dataset), *arguments],
        capture_output=True,
        text=True,
        env=env,
        check=False,
        timeout=240,
    )


def evaluated(tmp_path: Path, server: ModelServer, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Evaluate the two lines with an Ollama model."""
    return muster(tmp_path, "set.jsonl", "--planner", "ollama:llama3.1", *arguments, OLLAMA_HOST=server.url)


def test_the_tables_are_printed_and_the_files_written(tmp_path: Path) -> None:
    """SR by level, refusals apart; JSON, Markdown and a picture under the name that was given."""
    with model_server() as server:
        server.answers = [says(published_form(DRIVE)), says({"refusal": "There is no crane."})]
        done = evaluated(tmp_path, server, "--out", str(tmp_path / "results" / "first"))
    assert done.returncode == 0, done.stderr
    row = next(line.split() for line in done.stdout.splitlines() if line.startswith("L1"))
    assert row[:6] == ["L1", "1", "1.000", "1.000", "1.000", "1.000"]
    assert "1 of 1 instructions (100.0%)" in done.stdout
    result = json.loads((tmp_path / "results" / "first.json").read_text())
    assert (result["dataset"], result["complete"], len(result["answers"])) == ("set.jsonl", True, 2)
    assert "| L1 | 1 | 1.000 |" in (tmp_path / "results" / "first.md").read_text()
    assert (tmp_path / "results" / "first.png").read_bytes().startswith(b"\x89PNG")


def test_failures_are_listed_with_what_is_missing(tmp_path: Path) -> None:
    """Each by its id, with the text and the difference."""
    with model_server() as server:
        server.answers = [says({"refusal": "no"}), says(published_form(DRIVE))]
        done = evaluated(tmp_path, server, "--failures", "--repeat", "1")
    assert "dart_llm-L1-T1-001: refused" in done.stdout
    assert "x-L1: must be refused" in done.stdout
    assert "Good instructions refused: 1 of 1" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("nowhere.jsonl",), "nowhere.jsonl: No such file"),
        (("set.jsonl", "--planner", "nobody"), "'nobody'"),
        (("set.jsonl", "--out", "/dev/null/none"), "/dev/null"),
        (("set.jsonl", "--method", "smart-llm"), "cannot do --method smart-llm"),
        (("set.jsonl", "--planner", "ollama:llama3.1"), "ollama serve"),
    ],
)
def test_what_cannot_be_evaluated_is_one_clear_line(tmp_path: Path, arguments: tuple[str, ...], says: str) -> None:
    """With exit code 2 and no numbers."""
    done = muster(tmp_path, *arguments, OLLAMA_HOST="http://127.0.0.1:9")
    assert done.returncode == 2
    assert done.stdout == ""
    assert says in done.stderr
    assert "Traceback" not in done.stderr
