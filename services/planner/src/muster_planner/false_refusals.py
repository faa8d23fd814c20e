"""Refusals that the site itself contradicts: "there is no truck 2 here" where there is one.

A small model says that now and then of names that it reads with difficulty. Code knows better, and asks again.
"""

import re

from .short_names import SiteNames

_ABSENT = re.compile(r"\b(?:is|are) no (?P<words>[a-z][a-z _-]*?)[ _-]?(?P<number>\d{1,6})\b", re.IGNORECASE)


def is_contradicted(reason: str, names: SiteNames) -> bool:
    """Tell whether all that the reason calls absent, by class or type and number, is there."""
    absent = list(_ABSENT.finditer(reason))
    return bool(absent) and all(_is_there(m["words"].lower(), int(m["number"]), names) for m in absent)


def _is_there(words: str, number: int, names: SiteNames) -> bool:
    last = words.rsplit(maxsplit=1)[-1]
    if {f"{re.sub(r'[ -]', '_', words)}{number}", f"{last}{number}"} & set(names.objects):
        return True
    return any(
        f"{kind.letter}{number}" in kind.robots
        for kind in names.kinds
        if words in (kind.words, kind.words.rsplit(maxsplit=1)[-1], kind.letter.lower())
    )
