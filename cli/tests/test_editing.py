"""Editing a plan: what is refused changes nothing, and no edit is lost."""

import json
from pathlib import Path
from typing import Any

import httpx
import pytest
from muster_cli.editing import edit_from_file, edit_in_editor
from muster_cli.errors import CliError
from muster_cli.rest import OperatorApi
from rich.console import Console

PLAN: dict[str, Any] = {"tasks": [{"task": "a", "instruction_function": {"name": "Excavation", "robot_ids": ["r1"]}}]}


class Site:
    """An interface over HTTP that remembers what it was given, and refuses what it is told to."""

    def __init__(self, state: str = "awaiting_approval", refusal: str | None = None) -> None:
        self.state, self.refusal = state, refusal
        self.taken: list[tuple[dict[str, Any], str]] = []
        self.api = OperatorApi("http://site", None, httpx.MockTransport(self.answer))

    def answer(self, request: httpx.Request) -> httpx.Response:
        """Show a mission at plan revision 3; take a plan, or refuse it."""
        if request.method == "PUT":
            if self.refusal:
                return httpx.Response(422, json={"detail": self.refusal})
            self.taken.append((json.loads(request.content), request.url.params["plan_revision"]))
        mission = {"mission_id": "m-1", "revision": 1, "text": "dig", "state": self.state, "created_at": 1.0}
        return httpx.Response(200, json={**mission, "plan_revision": 3, "plan": PLAN, "proposals": {}, "tasks": []})


def test_a_file_replaces_the_plan_that_was_read(tmp_path: Path) -> None:
    """The revision goes with it, so that a plan that changed meanwhile is not overwritten."""
    file, site = tmp_path / "plan.json", Site()
    file.write_text(json.dumps(PLAN))
    edit_from_file(site.api, "m-1", file, Console(quiet=True))
    assert site.taken == [(PLAN, "3")]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "no JSON"),
        ('{"tasks": 5}', "tasks"),
        ('{"tasks": [{"task": ""}]}', "instruction_function"),
        ("[]", "plan"),
    ],
)
def test_what_is_no_plan_is_refused_with_reasons(tmp_path: Path, text: str, says: str) -> None:
    """Nothing is sent."""
    file, site = tmp_path / "plan.json", Site()
    file.write_text(text)
    with pytest.raises(CliError) as error:
        edit_from_file(site.api, "m-1", file, Console(quiet=True))
    assert says in str(error.value)
    assert site.taken == []


def test_only_a_plan_that_awaits_approval_is_edited(tmp_path: Path) -> None:
    """Said before anything is opened."""
    with pytest.raises(CliError) as error:
        edit_in_editor(Site("running").api, "m-1", Console(quiet=True))
    assert "running" in str(error.value)
    with pytest.raises(CliError):
        edit_from_file(Site().api, "m-1", tmp_path / "nowhere.json", Console(quiet=True))


def test_a_refused_edit_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The message says where, and how to send it again."""
    editor = tmp_path / "editor"
    editor.write_text('#!/bin/sh\nsed -i s/r1/r2/ "$1"\n')
    editor.chmod(0o755)
    monkeypatch.setenv("VISUAL", str(editor))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(CliError) as error:
        edit_in_editor(Site(refusal="There is no robot 'r2'.").api, "m-1", Console(quiet=True))
    (kept,) = tmp_path.glob("muster-edit-m-1-*.json")
    assert str(kept) in str(error.value)
    assert '"r2"' in kept.read_text()
    site = Site()
    edit_in_editor(site.api, "m-1", Console(quiet=True))
    assert site.taken[0][0]["tasks"][0]["instruction_function"]["robot_ids"] == ["r2"]
