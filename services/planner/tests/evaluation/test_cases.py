"""Data sets: three forms of lines, and what is wrong with lines of none."""

import json
from pathlib import Path
from typing import Any

import pytest
from muster_planner.evaluation.cases import Case, DatasetError, read_cases
from muster_planner.evaluation.testing import FLEET, THERE, plan

PUBLISHED: dict[str, Any] = {
    "ID": "dart_llm-L2-T1-007",
    "text": "Truck 1 to the puddle, then everyone keeps out of it.",
    "output": {
        "tasks": [
            {
                "task": "go",
                "instruction_function": {
                    "name": "target_area_for_specific_robots",
                    "robot_ids": ["robot_dump_truck_01"],
                    "robot_type": None,
                    "dependencies": [],
                    "object_keywords": ["puddle1"],
                },
            },
            {
                "task": "keep_out",
                "instruction_function": {
                    "name": "avoid_areas_for_all_robots",
                    "robot_ids": None,
                    "robot_type": ["dump_truck", "excavator"],
                    "dependencies": ["go"],
                    "object_keywords": ["puddle1"],
                },
            },
        ]
    },
}
OURS: dict[str, Any] = {
    "id": "x-1",
    "level": "L3",
    "text": "The excavators go home and one truck digs in.",
    "tasks": [
        {
            "key": "a",
            "skill": ["return_to_start_for_specific_robots"],
            "robots": [{"type": "excavator", "count": "all"}, [f"robot_excavator_0{n}" for n in (1, 2, 3)]],
            "objects": [[]],
            "optional": False,
        },
        {"key": "b", "skill": ["FD1"], "robots": [{"type": "dump_truck", "count": 1}], "objects": [[], ["soil1"]]},
    ],
    "before": [],
    "unordered": [["a", "b"]],
}
REFUSED: dict[str, Any] = {"id": "x-2", "level": "L1", "text": "Hoist the crane.", "refuse": "there is no crane"}


SHORT: dict[str, Any] = {
    "id": "v7-012",
    "level": "L2",
    "text": "Once EX1 has dug at the pile, truck 1 comes home.",
    "plan": "1 home T1 < 3 | 2 go E1 @ soil1 | 3 dig E1 @ soil1 < 2",
}


def read(path: Path, *lines: Any) -> list[Case]:
    """Read a file of these lines (text as it is, else as JSON)."""
    path.write_text("\n".join(line if isinstance(line, str) else json.dumps(line) for line in lines))
    return read_cases(path, THERE)


def test_the_published_form_is_read(tmp_path: Path) -> None:
    """Its level stands in the id; nulls are left out; the order is that of the dependencies."""
    [case] = read(tmp_path / "d.jsonl", PUBLISHED)
    assert (case.id, case.level, case.before) == ("dart_llm-L2-T1-007", "L2", (("go", "keep_out"),))
    assert [sorted(w.verbs) for w in case.wanted] == [["go"], ["avoid"]]
    assert case.wanted[1].robots == (FLEET.everyone,)


def test_our_form_is_read(tmp_path: Path) -> None:
    """Groups of robots are spelled out, so two ways to name the same ones are one."""
    case, refused = read(tmp_path / "d.jsonl", OURS, "", REFUSED)
    assert case.wanted[0].robots == (FLEET.by_type["excavator"],)
    assert case.wanted[1].robots == (("dump_truck?0",),)
    assert case.unordered == (("a", "b"),)
    assert (refused.refuse, refused.wanted) == ("there is no crane", ())


def test_the_short_notation_is_read(tmp_path: Path) -> None:
    """With references to later steps; the voice is what stands before the last dash of the id."""
    case, refused = read(tmp_path / "d.jsonl", SHORT, REFUSED | {"refuse": None, "plan": "refuse there is no crane"})
    assert (case.id, case.level, case.voice) == ("v7-012", "L2", "v7")
    assert case.reference == plan("a home T1 < c", "b go E1 @ soil1", "c dig E1 @ soil1 < b")
    assert refused.refuse == "there is no crane"


LONE = {"task": "a", "instruction_function": {"name": "Excavation", "dependencies": ["b"]}}
WRONG: list[tuple[Any, str]] = [
    ("no json", "no JSON"),
    ("[" * 100_000, "no JSON"),
    ("[]", "line: "),
    ({"id": "x", "tasks": []}, "text: Field required"),
    ({"id": "x", "text": "go"}, "none of"),
    (OURS | {"before": [["a", "z"]]}, "'z'"),
    (OURS | {"tasks": [*OURS["tasks"], OURS["tasks"][0]]}, "one key"),
    (OURS | {"tasks": [OURS["tasks"][0] | {"robots": "E1"}]}, "robots"),
    (PUBLISHED | {"output": {"tasks": []}}, "no task"),
    (PUBLISHED | {"output": {"tasks": [LONE]}}, "no task 'b'"),
    (SHORT | {"plan": "1 go E1 @ soil1 | 3 dig E1"}, "step 2 is '3 dig E1'"),
    (SHORT | {"plan": "1 go E9 @ soil1"}, "'E9'"),
    (SHORT | {"plan": "1 go E1 @ soil1 < 2"}, "waits for 'b'"),
    (SHORT | {"plan": "1 go E1 @ soil1 < 2 | 2 home E1 < 1"}, "cycle"),
    (SHORT | {"plan": ""}, "step 1"),
    ("x" * 300_000, "bytes"),
]


@pytest.mark.parametrize(("line", "says"), WRONG, ids=[says for _, says in WRONG])
def test_a_line_of_no_form_is_named(tmp_path: Path, line: Any, says: str) -> None:
    """With its number and what is wrong."""
    with pytest.raises(DatasetError, match=r"line 2: ") as caught:
        read(tmp_path / "d.jsonl", REFUSED, line)
    assert says in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_a_file_without_cases_or_with_one_twice_is_no_data_set(tmp_path: Path) -> None:
    """And neither is one that is not there."""
    with pytest.raises(DatasetError, match="no case"):
        read(tmp_path / "d.jsonl", "")
    with pytest.raises(DatasetError, match="more than one case 'x-2'"):
        read(tmp_path / "d.jsonl", REFUSED, REFUSED)
    with pytest.raises(DatasetError, match=r"Cannot read .*nowhere"):
        read_cases(tmp_path / "nowhere.jsonl", THERE)
