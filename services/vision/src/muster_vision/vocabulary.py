"""What is looked for: the site's classes, what someone asked for lately, and what bare ground is called."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from muster_schemas.site import Site

TEMPLATES: Final = ("{}", "{} seen from above", "an aerial photo of {}")
"""Wordings whose text vectors are averaged, as is usual for zero-shot classification with CLIP."""

BACKGROUNDS: Final = (
    "bare ground",
    "dry earth with nothing on it",
    "a shadow on the ground",
    "part of something cut off at the edge",
    "some other thing",
)

_NUMBER: Final = re.compile(r"[\s_-]*\d+$")
_NOT_ID: Final = re.compile(r"[^a-z0-9]+")


@dataclass(frozen=True)
class Vocabulary:
    """Classes with the words for each; machines are told apart from the rest because they are not put in the map."""

    classes: Mapping[str, str]
    """Class: prompt."""
    machines: frozenset[str]

    @property
    def names(self) -> tuple[str, ...]:
        """The classes in a fixed order; `prompts` has the same."""
        return tuple(self.classes)

    @property
    def prompts(self) -> tuple[tuple[str, ...], ...]:
        """For each class, then for each background, all its wordings."""
        wordings = [tuple(t.format(prompt) for t in TEMPLATES) for prompt in self.classes.values()]
        return (*wordings, *((words,) for words in BACKGROUNDS))


@dataclass
class Wishes:
    """The site's classes, and keywords for as long as someone wants them."""

    site: Site
    _until: dict[str, float] = field(default_factory=dict[str, float])
    _prompts: dict[str, str] = field(default_factory=dict[str, str])

    def want(self, keywords: Iterable[str], until: float) -> None:
        """Look for these words until then (a clock of the caller's choice)."""
        for keyword in keywords:
            name = class_of(keyword)
            if name and name not in self.site.vision.classes:
                self._until[name] = max(until, self._until.get(name, 0.0))
                self._prompts[name] = f"a {name.replace('_', ' ')}"

    def vocabulary(self, now: float, in_map: Sequence[str] = ()) -> Vocabulary:
        """Return what to look for now: what the site names, what is wanted, and what the map already holds."""
        wanted = {name for name, until in self._until.items() if until >= now} | set(in_map)
        extra = {name: self._prompts.get(name, f"a {name.replace('_', ' ')}") for name in sorted(wanted)}
        machines = {*self.site.robot_types, *(kind.body for kind in self.site.robot_types.values())}
        return Vocabulary({**extra, **self.site.vision.classes}, frozenset(machines))


def class_of(keyword: str) -> str:
    """Return the class that a keyword asks for: `puddle` for `puddle3`, `traffic_cone` for `Traffic cone 2`; or ''."""
    name = _NOT_ID.sub("_", _NUMBER.sub("", keyword.strip().lower())).strip("_")
    return name[:56].rstrip("_")
