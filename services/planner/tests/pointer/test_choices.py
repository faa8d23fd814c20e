"""Answers are rows of choices, and no row of allowed choices says what the site cannot do."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from muster_planner.plan_language import Refusal, decode
from muster_planner.pointer.choices import COUNT, END, ITEM, LINE, REFUSALS, REFUSE, Writing, choices_of
from muster_planner.pointer.scene import ItemType, Scene
from muster_schemas.gate import check_plan

from .yard import NAMES, SCENE, YARD


def place(name: str, kind: int = -1) -> int:
    """Return the choice that points at an item."""
    return ITEM + SCENE.places[name, kind]


def written(choices: list[int], scene: Scene = SCENE) -> Writing:
    """Return what the choices write, each checked to be allowed."""
    writing = Writing(scene)
    for choice in choices:
        assert choice in writing.allowed()
        writing = writing.after(choice)
    return writing


def at_random(random_: random.Random, scene: Scene) -> Writing:
    """Return an answer of choices drawn by chance; its end is drawn as soon as it may come, one time in four."""
    writing = Writing(scene)
    while not writing.ended:
        allowed = writing.allowed()
        assert allowed, writing.said()
        short = END in allowed and random_.random() < 0.25
        writing = writing.after(END if short else random_.choice(allowed))
    return writing


@given(st.integers())
def test_whatever_is_chosen_is_a_refusal_or_passes_the_gate(seed: int) -> None:
    """Unknown names, unable robots, missing objects and cycles have no choices that would say them."""
    writing = at_random(random.Random(seed), SCENE)
    if writing.refusal:
        assert writing.refusal in REFUSALS
        return
    plan = decode(writing.said(), NAMES)
    assert not isinstance(plan, Refusal)
    assert check_plan(plan, YARD.roster, YARD.objects, YARD.catalogue) == []


Lines = list[tuple[str, list[str], list[str], list[int]]]

WRITTEN: list[tuple[Lines, str]] = [
    ([("go", ["T1", "E1"], ["soil1"], [])], "a go E1 T1 @ soil1"),
    ([("home", ["all"], [], [])], "a home all"),
    ([("dig", ["E2"], [], []), ("dump", ["E2"], ["soil2"], [0])], "a dig E2\nb dump E2 @ soil2 < a"),
    ([("go", ["T:2"], ["rock1"], []), ("tip", ["T:2"], [], [0])], "a go T:2 @ rock1\nb tip T:2 < a"),
    ([("avoid", ["T*", "E*"], ["puddle2", "puddle1"], [])], "a avoid E* T* @ puddle1 puddle2"),
]


@pytest.mark.parametrize(("lines", "said"), WRITTEN)
def test_lines_become_choices_and_choices_lines(lines: Lines, said: str) -> None:
    """Robots and objects come in the scene's order; nothing else changes."""
    writing = written(choices_of(lines, SCENE))
    assert writing.ended
    assert writing.said() == said


def test_a_verb_of_a_type_is_followed_by_robots_of_that_type_only() -> None:
    """Trucks cannot be told to dig."""
    digging = Writing(SCENE).after(place("dig", 0))
    pointed = [SCENE.items[c - ITEM] for c in digging.allowed() if c >= ITEM]
    assert {i.kind for i in pointed} == {0}
    assert {i.type for i in pointed} == {ItemType.KIND, ItemType.ROBOT}


def test_driving_needs_a_place_and_going_home_takes_none() -> None:
    """A line cannot end before it has what its verb needs."""
    going = Writing(SCENE).after(place("go")).after(place("T1", 1))
    assert END not in going.allowed()
    assert place("soil1") in going.allowed()
    homing = Writing(SCENE).after(place("home")).after(place("T1", 1))
    assert END in homing.allowed()
    assert place("soil1") not in homing.allowed()


def test_a_line_waits_for_earlier_lines_only() -> None:
    """So nothing waits for itself, and no cycle can be said."""
    first = Writing(SCENE).after(place("home")).after(place("T1", 1))
    assert not any(LINE <= c < ITEM for c in first.allowed())
    second = first.after(place("home")).after(place("T2", 1))
    assert [c for c in second.allowed() if LINE <= c < ITEM] == [LINE]


def test_no_more_robots_are_counted_than_there_are() -> None:
    """Three trucks, so counts from one to three."""
    counting = Writing(SCENE).after(place("go")).after(place("T", 1))
    assert [c for c in counting.allowed() if c < LINE] == [COUNT, COUNT + 1, COUNT + 2]


def test_refusing_can_be_forbidden() -> None:
    """Then only verbs are left to begin with."""
    assert any(REFUSE <= c < COUNT for c in Writing(SCENE).allowed())
    assert not any(c < ITEM for c in Writing(SCENE).allowed(may_refuse=False))


def test_a_site_without_objects_leaves_only_what_needs_none() -> None:
    """Going home and digging where one stands."""
    empty = Scene(SCENE.kinds, SCENE.common, ())
    verbs = {empty.items[c - ITEM].name for c in Writing(empty).allowed() if c >= ITEM}
    assert verbs == {"home", "dig", "dump", "load", "tip"}
