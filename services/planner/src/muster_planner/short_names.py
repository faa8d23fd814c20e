"""Short names for robots, made from the live roster: `robot_dump_truck_02` is `T2` in the plan language.

A type's letter is the one that the site's file gives it, else the first letter of its last word that is still free
(`dump_truck`: T); a robot's number is the one that its id ends with, else its place in the roster.
"""

import re
import string
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from muster_schemas.robot import RobotCard
from muster_schemas.skills import Catalogue, Skill

_FINAL_NUMBER = re.compile(r"(\d{1,6})$")


@dataclass(frozen=True)
class Kind:
    """A type of robot on the site."""

    type: str
    letter: str
    robots: Mapping[str, str]
    """Short name -> robot id, by number."""
    verbs: tuple[str, ...]
    """What robots of this type can do beside what all can, in the catalogue's order."""

    @property
    def words(self) -> str:
        """Return the type as people say it: `dump truck`."""
        return self.type.replace("_", " ").replace("-", " ")


class SiteNames:
    """What the plan language may name on a site now: robots under short names, objects, verbs."""

    def __init__(
        self,
        roster: Sequence[RobotCard],
        objects: Iterable[str],
        catalogue: Catalogue,
        letters: Mapping[str, str] | None = None,
    ) -> None:
        self.catalogue = catalogue
        self.objects = tuple(sorted(set(objects)))
        types = sorted({c.type for c in roster})
        chosen = _letters(types, letters or {})
        kinds = (
            Kind(
                t, chosen[t], _numbered(chosen[t], [c.robot_id for c in roster if c.type == t]), self._verbs(t, roster)
            )
            for t in types
        )
        self.kinds = tuple(sorted(kinds, key=lambda k: k.letter))
        self.robot_ids: dict[str, str] = {short: full for k in self.kinds for short, full in k.robots.items()}
        self.short_names: dict[str, str] = {full: short for short, full in self.robot_ids.items()}
        self.types: dict[str, str] = {k.letter: k.type for k in self.kinds}
        self.letters: dict[str, str] = {k.type: k.letter for k in self.kinds}

    @property
    def common(self) -> tuple[Skill, ...]:
        """Return the skills of every robot, one a verb, in the catalogue's order (navigation and area rules)."""
        return tuple({s.verb: s for s in self.catalogue if not s.robot_types}.values())

    def _verbs(self, robot_type: str, roster: Sequence[RobotCard]) -> tuple[str, ...]:
        able = {name for c in roster if c.type == robot_type for name in c.skills}
        return tuple(s.verb for s in self.catalogue if s.name in able and s.robot_types and robot_type in s.robot_types)


def _letters(types: Sequence[str], given: Mapping[str, str]) -> dict[str, str]:
    """Return type -> letter, each letter once; types beyond the alphabet get two letters."""
    chosen: dict[str, str] = {}
    for robot_type in types:
        letter = given.get(robot_type, "").upper()
        if letter and letter not in chosen.values():
            chosen[robot_type] = letter
    pairs = [a + b for a in string.ascii_uppercase for b in string.ascii_uppercase]
    for robot_type in types:
        if robot_type not in chosen:
            words = re.findall(r"[a-z]+", robot_type)
            wanted = [w[0] for w in reversed(words)] + [c for w in words for c in w]
            options = [*(c.upper() for c in wanted), *string.ascii_uppercase, *pairs]
            chosen[robot_type] = next(c for c in options if c not in chosen.values())
    return chosen


def _numbered(letter: str, ids: Sequence[str]) -> dict[str, str]:
    """Return short name -> id; ids with equal or no final numbers are counted in the order of their names."""
    ids = sorted(set(ids))
    found = [_FINAL_NUMBER.search(i) for i in ids]
    numbers = [int(m[1]) for m in found if m]
    if len(set(numbers)) != len(ids):
        numbers = list(range(1, len(ids) + 1))
    return {f"{letter}{n}": full for n, full in sorted(zip(numbers, ids, strict=True))}


def said_in_words(text: str, names: SiteNames) -> str:
    """Return the text with whole robot ids (`robot_dump_truck_02`) as people say them (`dump truck 2`)."""
    words = {full: f"{k.words} {short.removeprefix(k.letter)}" for k in names.kinds for short, full in k.robots.items()}
    if not any(full in text for full in words):
        return text
    pattern = "|".join(re.escape(f) for f in sorted(words, key=len, reverse=True))
    return re.sub(rf"(?<![\w-])(?:{pattern})(?![\w-])", lambda m: words[m[0]], text)
