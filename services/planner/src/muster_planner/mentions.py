"""What an instruction's own words name by kind and number: `puddle 7`, `the third soil pile`, `trucks 1, 2 and 5`.

A small model is told only what is there, so it takes the nearest thing that is: asked for puddle 7 it may drive to
puddle 1. Numbers are the part of language that a program reads reliably, so what they name and the site lacks is looked
for, and if it is not found the instruction is refused, before any model is asked.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

_CARDINALS: Final = ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
_ORDINALS: Final = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
_NUMBERS: Final = {w: n for words in (_CARDINALS, _ORDINALS) for n, w in enumerate(words, start=1)}

_OTHER_WORDS: Final[Mapping[str, tuple[str, ...]]] = {
    "excavator": ("digger", "exc", "ex"),
    "dump_truck": ("truck", "hauler", "tipper", "dumper", "dt"),
}
"""What people call the paper's machines, beside the name of the type."""

_HEAP: Final = r"(?:[ \t-]*(?:pile|heap|mound|patch|area|site|spot|zone))?"
_ONE: Final = rf"(?:\d{{1,3}}|{'|'.join(_CARDINALS)})\b"
_COUNTED: Final = (
    r"(?!\s*(?:m|metres?|meters?|cm|km|min|minutes?|s|sec|seconds?|hours?|h|times|x|loads?|buckets?|%|[.,:]\d)\b"
    r"|\s+(?:all|the|d|u|ur)\b)"
)
"""What follows a number that says how much, how long or "for", not which."""
_AND: Final = rf"(?:\s*(?:and|&|\+|or)\s*{_ONE}{_COUNTED}(?!\s*[a-z]+s\b))"
_PLACES: Final = rf"{_ONE}{_COUNTED}(?:{_AND}(?!\s+(?:for|at|to|on|into|goes?)\b))?"
"""No list with commas: in "1 at soil 1, 2 at soil 2" the second number is a robot's, as it is before "at" and such."""
_ROBOTS: Final = rf"{_ONE}{_COUNTED}(?:(?:\s*,\s*{_ONE}{_COUNTED})*{_AND})?"
_CORRECTION: Final = re.compile(
    r"\b(?:sorry|correction|i mean|scratch that|make that|instead|actually|not|there(?:'s| is| are) no)\b|\bno\s*[,;:-]"
)


def corrects_itself(text: str) -> bool:
    """Return whether a number in the text may be one that it takes back."""
    return _CORRECTION.search(text.lower()) is not None


def numbers_of(text: str, kinds: Iterable[str], *, robots: bool) -> Iterator[tuple[str, int]]:
    """Yield (kind, number) for each explicit number, in the text's order for each kind.

    Args:
        text: the instruction.
        kinds: such as `puddle` or `dump_truck`.
        robots: whether they are robots, which are listed as "1, 2 and 5".

    """
    said = text.lower()
    for kind in kinds:
        words = "|".join(_words(kind))
        # On one line: the next one may begin with the number of a list
        named = rf"{_HEAP}[ \t_-]*(?:no\.?|number|nr\.?|#)?[ \t_-]*"
        after = rf"(?<![a-z])(?:{words})s?{named}(?P<list>{_ROBOTS if robots else _PLACES})"
        before = rf"\b(?P<ordinal>\d{{1,3}}(?:st|nd|rd|th)|{'|'.join(_ORDINALS)})\s+(?:{words})\b"
        for match in re.finditer(after, said):
            for number in re.findall(_ONE, match["list"]):
                yield kind, int(number) if number.isdigit() else _NUMBERS[number]
        for match in re.finditer(before, said):
            digits = re.match(r"\d+", match["ordinal"])
            yield kind, int(digits[0]) if digits else _NUMBERS[match["ordinal"]]


def kinds_of(text: str, kinds: Sequence[str]) -> list[str]:
    """Return the kinds that the text mentions at all."""
    said = text.lower()
    return [kind for kind in kinds if re.search(rf"(?<![a-z])(?:{'|'.join(_words(kind))})s?(?:\b|(?=\d))", said)]


def _words(kind: str) -> list[str]:
    """Return patterns for the words that people use for a kind, longest first."""
    own = re.escape(kind).replace("_", r"[\s_-]?")
    return sorted((own, *_OTHER_WORDS.get(kind, ())), key=len, reverse=True)
