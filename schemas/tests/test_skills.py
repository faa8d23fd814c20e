"""The skill catalogue."""

import pytest
from muster_schemas.skills import PAPER_CATALOGUE, PAPER_SKILLS, Catalogue, Skill, UnknownSkillError


def skill(name: str, *aliases: str) -> Skill:
    """Return a skill of a site's own."""
    return Skill(name=name, verb="sweep", text="sweep", aliases=aliases)


def test_the_papers_twelve_are_there() -> None:
    """Four ground skills in two variants, two of the excavator, two of the truck."""
    assert len(PAPER_SKILLS) == 12
    assert sum(s.fleet_wide for s in PAPER_SKILLS) == 4
    assert {s.number for s in PAPER_SKILLS} == {"N1", "N2", "N3", "N4", "FE1", "FE2", "FD1", "FD2"}


def test_a_name_and_its_aliases_are_one_skill() -> None:
    """However the data set says it, it is the same skill."""
    dig = PAPER_CATALOGUE["excavator_digging"]
    assert dig is PAPER_CATALOGUE["Excavation"] is PAPER_CATALOGUE["FE1"]
    assert "Excavation" in PAPER_CATALOGUE
    assert "Dancing" not in PAPER_CATALOGUE
    assert PAPER_CATALOGUE.canonical("Dancing") == "Dancing"


def test_an_unknown_skill_is_an_error_of_its_own() -> None:
    """It can be told from any other missing key."""
    with pytest.raises(UnknownSkillError, match="Dancing"):
        PAPER_CATALOGUE["Dancing"]


def test_a_site_adds_to_the_catalogue() -> None:
    """The paper's skills stay."""
    catalogue = Catalogue.with_site([skill("sweep_yard", "Sweeping")])
    assert catalogue["Sweeping"].name == "sweep_yard"
    assert len(list(catalogue)) == 13


def test_names_and_aliases_stand_for_one_skill_each() -> None:
    """A site cannot redefine a skill or take another's alias."""
    with pytest.raises(ValueError, match="two skills are named 'dump_loading'"):
        Catalogue.with_site([skill("dump_loading")])
    with pytest.raises(ValueError, match="'Excavation' stands for two skills"):
        Catalogue.with_site([skill("sweep_yard", "Excavation")])


def test_verbs_tell_skills_apart() -> None:
    """The planner's short words lead back to one skill each."""
    assert len(PAPER_CATALOGUE.by_verb) == len(PAPER_SKILLS)
    assert PAPER_CATALOGUE.by_verb["go", True].name == "target_area_for_all_robots"
