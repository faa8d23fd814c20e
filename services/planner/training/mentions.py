"""Finds the numbers of robots and objects in an instruction, so that they can be exchanged for others.

An instruction is only changed when every number in it is understood; "the other one", "both" and "the rest" keep their
meaning when robots change places, "the puddle" without a number (which is number 1) forbids changing puddles.
"""

import re
from dataclasses import dataclass

_ROBOT = {
    "E": r"excavators?|diggers?|exc?s?|exca|e",
    "T": r"dump[ -]?trucks?|trucks?|tippers?|dumpers?|haulers?|lorr(?:y|ies)|dts?|trk|t",
}
_OBJECT = {
    "puddle": r"puddles?|pools?|wet patch",
    "obstacle": r"obstacles?|obst?|blockage",
    "rock": r"rocks?|boulder",
    "soil": r"soil(?:[ -]?piles?)?|(?:soil )?piles?|heaps?|stockpiles?",
}
_CLASSES = {**_ROBOT, **_OBJECT}
_NUMBER = r"[123]|one|two|three"
_ORDINAL = r"first|second|third|1st|2nd|3rd"
VALUES = {
    w: i
    for ws in (("1", "2", "3"), ("one", "two", "three"), ("first", "second", "third"), ("1st", "2nd", "3rd"))
    for i, w in enumerate(ws, 1)
}
_FORMS = [tuple(w for w in VALUES if VALUES[w] == i) for i in (1, 2, 3)]
_BEFORE = {
    c: re.compile(
        rf"(?:^|(?<=[^a-z]))(?:{p})[ \-#.]*(?:no\.?|nos\.?|nr\.?|number|numbers|num)?[ \-#.]*$", re.IGNORECASE
    )
    for c, p in _CLASSES.items()
}
_AFTER = {c: re.compile(rf"[ -](?:{p})(?![a-z])", re.IGNORECASE) for c, p in _CLASSES.items() if len(p) > 1}
_LIST = re.compile(r"\s*(?:,|and|&|/|\+|or|then|,\s*and|-|n)\s*(?:(?:no\.?|number|nr\.?)\s*)?", re.IGNORECASE)
_TOKEN = re.compile(
    rf"(?<![\d.:])(?:(?<![a-z])(?P<ordinal>{_ORDINAL})(?![a-z])|(?P<number>[123])(?![\d:.]\d|\d|st|nd|rd|x\b|[ap]m)"
    r"|(?<![a-z])(?P<word>one|two|three)(?![a-z]))",
    re.IGNORECASE,
)
_COUNT_AFTER = re.compile(
    r"\s+(?:of|trucks|diggers|excavators|tippers|dumpers|machines|robots|buckets?|times?|loads?|"
    r"dump|puddles|obstacles|soil|piles|heaps|others?|more|are|have|go|tip|dig|haul|teams?)",
    re.IGNORECASE,
)
_COUNT_BEFORE = re.compile(
    r"(?:\ball|\bother|\bthe|\bany|\bthose|\bthese|\bthis|\bthat|\bwhich|\beach|\bno|\bevery|"
    r"\bfirst|\bsecond|\bboth|\blast|\byou|\bonly)\s+$",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Mention:
    """A number at text[start:end] that names robot or object `value` of `kind` (E, T, puddle, ...)."""

    start: int
    end: int
    kind: str
    value: int


def find(text: str) -> list[Mention] | None:
    """Return the numbered mentions in the text; None where a number is not understood."""
    found: list[Mention] = []
    for match in _TOKEN.finditer(text):
        word = match[0].lower()
        head, tail = text[: match.start()], text[match.end() :]
        kind = None
        if match["ordinal"]:
            kind = next((c for c, p in _AFTER.items() if p.match(tail)), None)
            if kind is None:
                continue
        else:
            kind = next((c for c, p in _BEFORE.items() if p.search(head[-30:])), None)
            if kind is None and found and _LIST.fullmatch(text[found[-1].end : match.start()]):
                kind = found[-1].kind
            if kind is None and match["word"] and (_COUNT_BEFORE.search(head) or _COUNT_AFTER.match(tail)):
                continue
            if kind is None and _COUNT_AFTER.match(tail):
                continue
            if kind is None and re.match(r"[).:]\s", tail):
                continue
        if kind is None:
            return None
        found.append(Mention(match.start(), match.end(), kind, VALUES[word]))
    return found


def rewrite(text: str, mentions: list[Mention], numbers: dict[tuple[str, int], int]) -> str:
    """Return the text with every mention's number exchanged, in the form (digit, word, ordinal) that it had."""
    words = {4: "four", 5: "five", 6: "six", 7: "seven", 8: "eight", 9: "nine"}
    out: list[str] = []
    at = 0
    for m in mentions:
        new = numbers.get((m.kind, m.value), m.value)
        old = text[m.start : m.end]
        form = _FORMS[m.value - 1].index(old.lower())
        beyond = (str(new), words.get(new, ""), f"{new}th", f"{new}th")
        word = _FORMS[new - 1][form] if new <= 3 else beyond[form]
        if old[0].isupper():
            word = word.upper() if old.isupper() and len(old) > 1 else word.capitalize()
        out += [text[at : m.start], word]
        at = m.end
    return "".join([*out, text[at:]])
