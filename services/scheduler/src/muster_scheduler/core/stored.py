"""How what a task has from the catalogue stands in a snapshot's JSON."""

from functools import lru_cache
from typing import Annotated

from muster_schemas.skills import Catalogue, Skill
from pydantic import PlainSerializer, PlainValidator, TypeAdapter

_SKILLS = TypeAdapter(tuple[Skill, ...])


@lru_cache(maxsize=1024)
def _skill_text(skill: Skill) -> str:
    return skill.model_dump_json()


@lru_cache(maxsize=1024)
def _skill_of_text(text: str) -> Skill:
    return Skill.model_validate_json(text)


def _as_skill(value: object) -> Skill:
    return value if isinstance(value, Skill) else _skill_of_text(str(value))


def _catalogue_text(catalogue: Catalogue) -> str:
    return _SKILLS.dump_json(tuple(catalogue)).decode()


def _as_catalogue(value: object) -> Catalogue:
    return value if isinstance(value, Catalogue) else Catalogue(_SKILLS.validate_json(str(value)))


StoredSkill = Annotated[Skill, PlainValidator(_as_skill), PlainSerializer(_skill_text)]
"""A text, so that each skill is read once, not for every task, and stays one object."""

StoredCatalogue = Annotated[Catalogue, PlainValidator(_as_catalogue), PlainSerializer(_catalogue_text)]
"""A text of all its skills."""
