"""Every message survives its JSON, and no number or text that would harm a reader gets into one."""

import json
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st
from muster_schemas.base import Message, Point, Pose
from muster_schemas.channels import CHANNELS
from muster_schemas.examples import EXAMPLES
from muster_schemas.mission import MissionStatus, TaskStatus
from muster_schemas.robot import Load, RobotCard, SkillStatusKind
from muster_schemas.world import AreaRules, MapObject
from pydantic import BaseModel, ValidationError

MESSAGES: dict[str, BaseModel] = {
    **{name: example.message for name, example in EXAMPLES.items()},
    **{f"{name} reply": example.reply for name, example in EXAMPLES.items() if example.reply},
}


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_survives_its_json(name: str) -> None:
    """What is written is read as the same message, and written again the same."""
    message = MESSAGES[name]
    text = message.model_dump_json(by_alias=True)
    again = type(message).model_validate_json(text)
    assert again == message
    assert again.model_dump_json(by_alias=True) == text


@pytest.mark.parametrize("name", MESSAGES)
def test_fields_of_newer_programs_are_ignored(name: str) -> None:
    """A field that is not known yet does not make a message unreadable."""
    message = MESSAGES[name]
    fields = json.loads(message.model_dump_json(by_alias=True))
    assert type(message).model_validate_json(json.dumps({**fields, "from_the_future": [1]})) == message


@pytest.mark.parametrize("name", MESSAGES)
def test_no_number_is_infinite_or_missing(name: str) -> None:
    """NaN and infinity are refused wherever a message has a float."""
    message = MESSAGES[name]
    fields = json.loads(message.model_dump_json(by_alias=True))
    for where in floats(fields):
        for bad in (float("nan"), float("inf"), float("-inf")):
            with pytest.raises(ValidationError):
                type(message).model_validate_json(json.dumps(changed(fields, where, bad)))


@pytest.mark.parametrize("name", MESSAGES)
@given(
    rubbish=st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=10), inner, max_size=3),
        max_leaves=8,
    )
)
def test_rubbish_is_a_message_or_a_validation_error(name: str, rubbish: Any) -> None:
    """Whatever stands in one field, reading gives a message or `ValidationError`, never anything else."""
    message = MESSAGES[name]
    fields = json.loads(message.model_dump_json(by_alias=True))
    for field in fields:
        try:
            read = type(message).model_validate_json(json.dumps({**fields, field: rubbish}))
        except ValidationError:
            continue
        assert isinstance(read, type(message))


def test_messages_cannot_be_changed() -> None:
    """What was sent or received stays what it was."""
    with pytest.raises(ValidationError, match="frozen"):
        Point(x=1, y=2).x = 3  # pyright: ignore[reportAttributeAccessIssue]


def test_every_message_of_the_table_is_strict_about_floats() -> None:
    """All models share the base that refuses NaN, or wrap ones that do."""
    models = {c.model for c in CHANNELS} | {c.reply for c in CHANNELS if c.reply}
    plain = {m.__name__ for m in models if not issubclass(m, Message)}
    assert plain == {"SimCommand", "_Token"}


@pytest.mark.parametrize("x", [10_001, -10_001, float("nan"), "east"])
def test_nobody_drives_off_the_map(x: object) -> None:
    """Places lie within ten kilometres."""
    with pytest.raises(ValidationError):
        Pose.model_validate({"x": x, "y": 0})


def test_ended_states_are_known() -> None:
    """What has ended and what is final is said by the states themselves."""
    assert {s for s in MissionStatus if s.ended} == {"rejected", "succeeded", "failed", "cancelled"}
    assert {s for s in TaskStatus if s.ended} == {"succeeded", "failed", "cancelled", "skipped"}
    assert {s for s in SkillStatusKind if not s.final} == {"accepted", "started", "progress", "paused"}


def test_an_objects_radius_holds_its_outline() -> None:
    """The circle around an object reaches its farthest corner, or half its longer side without an outline."""
    soil = EXAMPLES["object"].message
    assert isinstance(soil, MapObject)
    assert soil.radius_m == pytest.approx(2.4)
    shaped = soil.model_copy(update={"shape": (Point(x=-10, y=15), Point(x=-9, y=12))})
    assert shaped.radius_m == pytest.approx(3.0)


def test_a_robots_radius_holds_its_corners() -> None:
    """The circle around a robot reaches its corners."""
    card = EXAMPLES["robot_card"].message
    assert isinstance(card, RobotCard)
    assert card.radius_m == pytest.approx((1.8**2 + 1.25**2) ** 0.5)


def test_rules_are_found_by_robot() -> None:
    """A robot's rules are its own."""
    rules = EXAMPLES["areas"].message
    assert isinstance(rules, AreaRules)
    assert [r.object_name for r in rules.avoided_by("robot_excavator_01")] == ["puddle1"]
    assert rules.avoided_by("robot_excavator_02") == ()


def test_a_spoonful_is_no_load() -> None:
    """A bucket counts as empty with a spoonful of soil, not with a rock."""
    assert Load(soil_m3=0.005).empty
    assert not Load(soil_m3=0.1).empty
    assert not Load(bodies=("rock1",)).empty


def floats(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths to all floats in parsed JSON."""
    if isinstance(value, float):
        return [path]
    inner: list[tuple[Any, Any]] = []
    if isinstance(value, dict):
        inner = list(cast("dict[Any, Any]", value).items())
    elif isinstance(value, list):
        inner = list(enumerate(cast("list[Any]", value)))
    return [found for key, item in inner for found in floats(item, (*path, key))]


def changed(value: Any, path: tuple[Any, ...], new: float) -> Any:
    """Return parsed JSON with one place changed."""
    if not path:
        return new
    key, *rest = path
    copy: Any = value.copy()
    copy[key] = changed(value[key], tuple(rest), new)
    return copy
