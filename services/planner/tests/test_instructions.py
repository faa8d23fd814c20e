"""What becomes of an instruction's text."""

import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st
from muster_planner.instructions import InstructionError, clean_instruction


def test_text_is_composed_and_on_one_line() -> None:
    """NFC, line breaks to spaces, runs of spaces to one."""
    assert clean_instruction("1. dig\r\n2.\tso\u0308il  now ") == "1. dig 2. s\u00f6il now"


def test_invisible_characters_are_taken_out() -> None:
    """Controls, zero-width and direction marks, halves of characters."""
    assert clean_instruction("d\u0007i\u200bg\u202e\ud800") == "dig"


@pytest.mark.parametrize("text", ["", "  \n", "\x00\x07", "\u200b\ufeff"])
def test_nothing_is_no_instruction(text: str) -> None:
    """The error says what to do."""
    with pytest.raises(InstructionError, match="Say what"):
        clean_instruction(text)


def test_too_long_is_counted_after_cleaning() -> None:
    """2,000 characters may stay, one more may not."""
    assert len(clean_instruction("  " + "x" * 2000 + "\n")) == 2000
    with pytest.raises(InstructionError, match="2001 characters; 2000 are allowed"):
        clean_instruction("x" * 2001)


@given(st.text(max_size=300))
def test_cleaning_twice_is_cleaning_once(text: str) -> None:
    """Whatever comes in, what comes out is clean, encodable, and stays as it is."""
    try:
        cleaned = clean_instruction(text)
    except InstructionError:
        return
    assert clean_instruction(cleaned) == cleaned
    assert cleaned.encode()
    assert not any(unicodedata.category(c).startswith("C") for c in cleaned)
