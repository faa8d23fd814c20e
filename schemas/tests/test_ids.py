"""Ids: what may become part of a key, a path or a URL."""

import re
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from muster_schemas.ids import ID_PATTERN, Id, InvalidIdError, check_id, new_boot_id, new_id
from pydantic import TypeAdapter, ValidationError


@given(st.text(max_size=80))
def test_an_id_passes_only_by_the_pattern(text: str) -> None:
    """The check and the model's field agree with the pattern on every text."""
    good = re.fullmatch(r"[a-z0-9_-]{1,64}", text) is not None
    try:
        assert check_id(text) == text
        passed = True
    except InvalidIdError:
        passed = False
    try:
        TypeAdapter(Id).validate_python(text)
        modelled = True
    except ValidationError:
        modelled = False
    assert (passed, modelled) == (good, good)


def test_the_message_says_what_is_wrong_and_what_is_allowed() -> None:
    """A person who mistyped an id can put it right."""
    with pytest.raises(InvalidIdError, match=r"mission_id 'M 1' must be 1 to 64 characters of a-z, 0-9, '_' and '-'"):
        check_id("M 1", "mission_id")


def test_a_long_wrong_id_is_cut_in_the_message() -> None:
    """A megabyte of rubbish makes no megabyte of log."""
    with pytest.raises(InvalidIdError) as caught:
        check_id("X" * 1_000_000)
    assert len(str(caught.value)) < 200


def test_new_ids_are_valid_unique_and_sortable_by_time() -> None:
    """A later id sorts after an earlier one, and two of the same millisecond differ."""
    first = new_boot_id()
    begun = time.time_ns()
    while time.time_ns() - begun < 2_000_000:  # the clock's step in ids is a millisecond
        pass
    second = new_boot_id()
    assert re.fullmatch(ID_PATTERN, first)
    assert first < second
    assert len({new_id("m") for _ in range(1000)}) == 1000
