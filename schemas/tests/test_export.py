"""What is generated from the models: the page of channels and the JSON Schemas."""

import json
from pathlib import Path

import pytest
from muster_schemas import export
from muster_schemas.channels import CHANNELS

ROOT = Path(__file__).parents[2]


def test_the_generated_files_say_what_the_models_say() -> None:
    """Nobody changed a model without generating again, or a generated file by hand."""
    assert export.main([str(ROOT), "--check"]) == 0


def test_nothing_is_left_of_models_that_are_gone() -> None:
    """There is a schema for each model of the table and no other."""
    lying = {p.relative_to(ROOT).as_posix() for p in (ROOT / "schemas/json").glob("*.json")}
    assert lying == {name for name in export.files() if name.startswith("schemas/json/")}


def test_writing_and_checking_agree(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Check reports what is missing or changed and changes nothing; after writing it is content."""
    assert export.main([str(tmp_path), "--check"]) == 1
    assert list(tmp_path.iterdir()) == []
    assert export.main([str(tmp_path)]) == 0
    assert export.main([str(tmp_path), "--check"]) == 0
    (tmp_path / "docs/channels.md").write_text("something else")
    capsys.readouterr()
    assert export.main([str(tmp_path), "--check"]) == 1
    assert "docs/channels.md is not what the models say" in capsys.readouterr().err


def test_the_page_lists_every_key() -> None:
    """Each row of the table stands on the page with its key and meaning."""
    page = export.channels_page()
    for channel in CHANNELS:
        assert f"| `{channel.template}` |" in page
        assert channel.what in page


def test_schemas_are_json_schemas_of_what_is_on_the_wire() -> None:
    """A robot's maker finds the names that stand in the JSON, such as `class` of an object."""
    schema = json.loads(export.files()["schemas/json/MapObject.json"])
    assert "class" in schema["properties"]
    assert "object_class" not in schema["properties"]
