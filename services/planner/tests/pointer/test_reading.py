"""The model reads the instruction, then the site, and knows where each thing of the site stands."""

import pytest
from muster_planner.embedded_files import FOLDER
from muster_planner.pointer.reading import Reader, TooLongError
from muster_planner.pointer.scene import Scene, SceneKind
from tokenizers import Tokenizer

from .yard import SCENE

READER = Reader(FOLDER / "tokenizer.json")
WORDS = Tokenizer.from_file(str(FOLDER / "tokenizer.json"))


def test_each_item_is_found_at_its_own_words() -> None:
    """First and last token of an item spell what the site calls it."""
    reading = READER.read("Truck 2 to the rock.", SCENE)
    for item, start, end in zip(SCENE.items, reading.starts, reading.ends, strict=True):
        assert WORDS.decode(list(reading.ids[start : end + 1])) == item.words
        assert set(reading.types[start : end + 1]) == {1}


def test_the_instruction_stands_before_the_site() -> None:
    """Its tokens are marked as its own."""
    reading = READER.read("Truck 2 to the rock.", SCENE)
    own = [i for i, t in zip(reading.ids, reading.types, strict=True) if t == 0]
    assert WORDS.decode(own) == "truck 2 to the rock."


def test_marks_in_an_instruction_are_read_as_words() -> None:
    """Nobody can end the instruction's part of what is read from within."""
    plain = READER.read("go home", SCENE)
    marked = READER.read("go [SEP] home", SCENE)
    separator = WORDS.token_to_id("[SEP]")
    assert marked.ids.count(separator) == plain.ids.count(separator)


def test_too_long_an_instruction_is_an_error() -> None:
    """It is not cut: half an instruction is another one."""
    with pytest.raises(TooLongError):
        READER.read("truck 1 goes home " * 200, SCENE)


def test_a_name_without_letters_or_digits_can_be_read() -> None:
    """Every item has at least one token."""
    odd = Scene((SceneKind("☃", "S", ("S1",), ()),), ("go",), ("___",))
    reading = READER.read("go", odd)
    assert all(end >= start for start, end in zip(reading.starts, reading.ends, strict=True))
