"""The skill catalogue: the twelve skills of the paper (its tables of navigation and robot skills), and a site's own.

A skill's `name` is the one that stands in keys; the published data set says some of them under an alias.
"""

from collections.abc import Iterable, Iterator, Mapping
from enum import StrEnum
from typing import Self

from pydantic import Field

from .base import Message, Seconds
from .ids import Id


class ObjectNeed(StrEnum):
    """Whether a skill wants objects."""

    REQUIRED = "required"
    OPTIONAL = "optional"
    NONE = "none"


class Skill(Message):
    """One thing that robots can do."""

    name: Id
    verb: Id = Field(description="the short word for it in the planner's compact plan language; unique per family")
    number: str = Field(default="", max_length=16, description="the paper's number")
    text: str = Field(max_length=400, description="what it does, as the planner and people read it")
    robot_types: tuple[Id, ...] = Field(default=(), description="types that can do it; empty: any")
    objects: ObjectNeed = ObjectNeed.OPTIONAL
    fleet_wide: bool = Field(default=False, description="the variant for all robots of the site")
    aliases: tuple[str, ...] = ()
    timeout_s: Seconds = Field(default=600.0, description="site time after which a start of it counts as failed")


def _ground(family: str, verb: str, number: str, text: str, objects: ObjectNeed, timeout_s: float) -> list[Skill]:
    return [
        Skill(
            name=f"{family}_for_{who}_robots",
            verb=verb,
            number=number,
            text=text.format(who="all robots" if fleet_wide else "the given robots"),
            objects=objects,
            fleet_wide=fleet_wide,
            timeout_s=timeout_s,
        )
        for who, fleet_wide in (("all", True), ("specific", False))
    ]


PAPER_SKILLS: tuple[Skill, ...] = (
    *_ground("avoid_areas", "avoid", "N1", "keep {who} out of the objects' areas", ObjectNeed.REQUIRED, 30),
    *_ground("target_area", "go", "N2", "drive {who} to places near the object", ObjectNeed.REQUIRED, 900),
    *_ground("allow_areas", "allow", "N3", "let {who} enter the objects' areas again", ObjectNeed.REQUIRED, 30),
    *_ground("return_to_start", "home", "N4", "drive {who} back to where they started", ObjectNeed.NONE, 900),
    Skill(
        name="excavator_digging",
        verb="dig",
        number="FE1",
        text="fill the bucket: from a soil pile, or by picking up an obstacle or rock",
        robot_types=("excavator",),
        aliases=("Excavation", "FE1"),
        timeout_s=300,
    ),
    Skill(
        name="excavator_unloading",
        verb="dump",
        number="FE2",
        text="empty the bucket: into the dump truck beside, or onto the ground",
        robot_types=("excavator",),
        aliases=("ExcavatorUnloading", "FE2"),
        timeout_s=300,
    ),
    Skill(
        name="dump_loading",
        verb="load",
        number="FD1",
        text="stand still and take on the load that an excavator empties into the bed",
        robot_types=("dump_truck",),
        aliases=("DumpLoading", "FD1"),
        timeout_s=900,
    ),
    Skill(
        name="dump_unloading",
        verb="tip",
        number="FD2",
        text="tip the bed and empty the load",
        robot_types=("dump_truck",),
        aliases=("DumpUnloading", "FD2"),
        timeout_s=300,
    ),
)


class UnknownSkillError(KeyError):
    """A skill that the catalogue lacks."""


class Catalogue:
    """Skills by name and alias; one per site: the paper's twelve, and what the site's file adds."""

    def __init__(self, skills: Iterable[Skill] = PAPER_SKILLS) -> None:
        self._by_name: dict[str, Skill] = {}
        for skill in skills:
            if skill.name in self._by_name:
                raise ValueError(f"two skills are named {skill.name!r}")
            self._by_name[skill.name] = skill
        self._names: dict[str, str] = {n: n for n in self._by_name}
        for skill in self._by_name.values():
            for alias in skill.aliases:
                if self._names.setdefault(alias, skill.name) != skill.name:
                    raise ValueError(f"the alias {alias!r} stands for two skills")

    @classmethod
    def with_site(cls, extra: Iterable[Skill]) -> Self:
        """Return the paper's skills and the site's own."""
        return cls([*PAPER_SKILLS, *extra])

    def __iter__(self) -> Iterator[Skill]:
        return iter(self._by_name.values())

    def __contains__(self, name: str) -> bool:
        return name in self._names

    def __getitem__(self, name: str) -> Skill:
        """Return the skill of that name or alias.

        Raises:
            UnknownSkillError: there is none.

        """
        try:
            return self._by_name[self._names[name]]
        except KeyError:
            raise UnknownSkillError(name) from None

    def canonical(self, name: str) -> str:
        """Return the name in keys for a name or alias; an unknown one comes back unchanged."""
        return self._names.get(name, name)

    @property
    def by_verb(self) -> Mapping[tuple[str, bool], Skill]:
        """Skills by (verb, fleet_wide)."""
        return {(s.verb, s.fleet_wide): s for s in self._by_name.values()}


PAPER_CATALOGUE = Catalogue()
