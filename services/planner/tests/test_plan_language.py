"""The plan language says every plan of the corpus and reads it back unchanged."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from muster_planner.plan_language import PlanLanguageError, Refusal, decode, encode, label
from muster_planner.short_names import SiteNames
from muster_planner.surroundings import Surroundings
from muster_schemas.gate import check_plan
from muster_schemas.plan import Plan
from muster_schemas.site import load_site

PLANNER = Path(__file__).resolve().parents[1]
YARD = Surroundings.of_file(load_site(PLANNER.parents[1] / "sites" / "yard.yaml"))
NAMES = SiteNames(YARD.roster, YARD.objects, YARD.catalogue, YARD.letters)

FLEET_SKILLS = {"go": "target_area", "home": "return_to_start", "avoid": "avoid_areas", "allow": "allow_areas"}
WORK_SKILLS = {"dig": "Excavation", "dump": "ExcavatorUnloading", "load": "DumpLoading", "tip": "DumpUnloading"}
TYPES = {"E": "excavator", "T": "dump_truck"}


def corpus_lines() -> Iterator[tuple[str, str]]:
    """Yield (id, plan in corpus notation) of everything that the model is trained on."""
    for path in sorted((PLANNER / "training" / "data").glob("*.jsonl")):
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.strip():
                row = json.loads(line)
                yield row["id"], row["plan"]


def published(notation: str) -> dict[str, Any]:
    """Write out corpus notation in the published form, without any of the code under test."""
    tasks: list[dict[str, Any]] = []
    steps = [re.fullmatch(r"(\d+) (\w+) ([^@<]+?)(?: @ ([^<]+?))?(?: < (.+))?", s) for s in notation.split(" | ")]
    found = [s for s in steps if s]
    assert len(found) == len(steps)
    words = [s[3].split() for s in found]
    names = [
        WORK_SKILLS.get(s[2]) or f"{FLEET_SKILLS[s[2]]}_for_{'all' if w == ['all'] else 'specific'}_robots"
        for s, w in zip(found, words, strict=True)
    ]
    for n, (step, robots) in enumerate(zip(found, words, strict=True)):
        if robots == ["all"]:
            who: dict[str, Any] = {"robot_type": ["dump_truck", "excavator"], "robot_count": "all"}
        elif re.search(r"[*:]", robots[0]):
            count = robots[0][1:]
            who = {"robot_type": [TYPES[robots[0][0]]], "robot_count": "all" if count == "*" else int(count[1:])}
        else:
            who = {"robot_ids": [f"robot_{TYPES[r[0]]}_0{r[1]}" for r in robots]}
        before = [f"{names[int(b) - 1]}_{b}" for b in (step[5] or "").split()]
        function = {"name": names[n], **who, "dependencies": before, "object_keywords": (step[4] or "").split()}
        tasks.append({"task": f"{names[n]}_{n + 1}", "instruction_function": function})
    return {"tasks": tasks}


def test_every_corpus_plan_is_said_and_read_back_unchanged() -> None:
    """Encoding a published plan and decoding the text gives the same plan, names and order of tasks included."""
    count = 0
    for row_id, notation in corpus_lines():
        if not notation.startswith("refuse "):
            plan = Plan.model_validate(published(notation))
            assert decode(encode(plan, NAMES), NAMES) == plan, row_id
            count += 1
    assert count > 2000


def test_every_corpus_plan_passes_the_gate() -> None:
    """What the model is taught may run on the default site."""
    for row_id, notation in corpus_lines():
        if not notation.startswith("refuse "):
            plan = Plan.model_validate(published(notation))
            assert check_plan(plan, YARD.roster, YARD.objects, YARD.catalogue) == [], row_id


def test_the_language_is_one_short_line_a_task() -> None:
    """The documented example looks as documented."""
    plan = decode("a go E1 T1 @ soil1\nb dig E1 @ soil1 < a\nc avoid all @ puddle1 puddle2 < a b\nd tip T:2", NAMES)
    assert isinstance(plan, Plan)
    assert [t.task for t in plan.tasks] == [
        "target_area_for_specific_robots_1",
        "Excavation_2",
        "avoid_areas_for_all_robots_3",
        "DumpUnloading_4",
    ]
    tip = plan.tasks[3].instruction_function
    assert (tip.robot_type, tip.robot_count) == (("dump_truck",), 2)
    assert plan.tasks[2].instruction_function.dependencies == ("target_area_for_specific_robots_1", "Excavation_2")


def test_a_line_may_wait_for_a_later_one() -> None:
    """The order of the lines need not be the order of the work."""
    plan = decode("a home E2 < b\nb go E2 @ rock1", NAMES)
    assert isinstance(plan, Plan)
    assert plan.tasks[0].instruction_function.dependencies == ("target_area_for_specific_robots_2",)
    assert encode(plan, NAMES) == "a home E2 < b\nb go E2 @ rock1"


def test_a_refusal_keeps_its_reason() -> None:
    """A refusal is read as one, with or without words."""
    assert decode("refuse there is no truck 7 here", NAMES) == Refusal("there is no truck 7 here")
    assert decode("refuse", NAMES) == Refusal("it cannot be done here")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "empty"),
        ("a fly E1 @ soil1", "no verb 'fly'"),
        ("a go E7 @ soil1", "no robot 'E7'"),
        ("a go E1 @ moon1", "no object 'moon1'"),
        ("a go E1 @ soil1 < c", "no line's label"),
        ("b go E1 @ soil1", "must have the label 'a'"),
        ("a dig all @ soil1", "no verb 'dig' for the whole fleet"),
        ("a go E* T1 @ soil1", "not both"),
        ("a go X* @ soil1", "no type 'X'"),
        ("a go", "is not 'label verb robots"),
    ],
)
def test_what_cannot_be_read_is_said_with_its_place(text: str, complaint: str) -> None:
    """Every error names the line and what is wrong with it."""
    with pytest.raises(PlanLanguageError, match=re.escape(complaint)):
        decode(text, NAMES)


def test_what_cannot_be_said_is_an_error() -> None:
    """Robots and skills that are not on the site, and a count over several types, have no words."""
    task = {"task": "x", "instruction_function": {"name": "Excavation", "robot_ids": ["robot_excavator_09"]}}
    mixed = {"name": "target_area_for_specific_robots", "robot_type": ["excavator", "dump_truck"], "robot_count": 2}
    for function, complaint in ((task["instruction_function"], "no robot"), (mixed, "several types")):
        plan = Plan.model_validate({"tasks": [{"task": "x", "instruction_function": function}]})
        with pytest.raises(PlanLanguageError, match=complaint):
            encode(plan, NAMES)


def test_labels_go_on_after_z() -> None:
    """A plan of a hundred tasks has a label for each."""
    labels = [label(n) for n in range(100)]
    assert labels[:2] == ["a", "b"]
    assert labels[25:28] == ["z", "aa", "ab"]
    assert len(set(labels)) == 100
