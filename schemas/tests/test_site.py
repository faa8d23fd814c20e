"""The site's file: the default one, and what is said about one that cannot be used."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from muster_schemas.site import Site, SiteError, load_site

ROOT = Path(__file__).parents[2]

SMALL: dict[str, Any] = {
    "name": "test",
    "bounds": {"min_x": 0, "min_y": 0, "max_x": 10, "max_y": 10},
    "robot_types": {"excavator": {"length_m": 3, "width_m": 2, "max_speed_mps": 1}},
    "robots": [{"id": "e1", "type": "excavator", "home": {"x": 1, "y": 1}}],
}


def write(path: Path, **changes: Any) -> Path:
    """Write a small site with these changes and return its file."""
    file = path / "site.yaml"
    file.write_text(yaml.safe_dump({**SMALL, **changes}))
    return file


def test_the_default_site_has_what_the_operators_know() -> None:
    """Six robots, seven things and the names under which people speak of them."""
    site = load_site(ROOT / "sites/yard.yaml")
    assert [r.id for r in site.robots] == [
        *(f"robot_excavator_0{i}" for i in (1, 2, 3)),
        *(f"robot_dump_truck_0{i}" for i in (1, 2, 3)),
    ]
    assert {t.name for t in site.things} == {
        "puddle1", "puddle2", "obstacle1", "obstacle2", "rock1", "soil1", "soil2",
    }  # fmt: skip
    for robot in site.robots:
        assert site.bounds.min_x < robot.home.x < site.bounds.max_x
        assert site.bounds.min_y < robot.home.y < site.bounds.max_y


def test_a_card_is_made_of_the_sites_entry() -> None:
    """A robot's card has its type's measures and skills, its home and this life's boot id."""
    site = load_site(ROOT / "sites/yard.yaml")
    card = site.card("robot_dump_truck_02", "boot-7")
    assert (card.type, card.boot_id, card.capacity_m3) == ("dump_truck", "boot-7", 1.5)
    assert {"dump_loading", "dump_unloading", "target_area_for_specific_robots"} <= set(card.skills)
    assert "excavator_digging" not in card.skills


def test_a_robot_that_is_not_there_has_no_card() -> None:
    """The message lists those that are there."""
    with pytest.raises(SiteError, match="has no robot 'robot_9'; it has robot_excavator_01, "):
        load_site(ROOT / "sites/yard.yaml").card("robot_9", "boot-1")


def test_a_new_type_with_new_skills_needs_only_its_entry(tmp_path: Path) -> None:
    """A sweeper that sweeps is on the site as soon as the file says so."""
    site = load_site(
        write(
            tmp_path,
            robot_types={"sweeper": {"length_m": 1, "width_m": 1, "max_speed_mps": 1, "skills": ["sweep_yard"]}},
            robots=[{"id": "s1", "type": "sweeper", "home": {"x": 1, "y": 1}}],
            skills=[{"name": "sweep_yard", "verb": "sweep", "text": "sweep the ground"}],
        )
    )
    assert "sweep_yard" in site.card("s1", "boot-1").skills
    assert "sweep_yard" in site.catalogue


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"name": "My Yard"}, "name: String should match pattern"),
        ({"bounds": {"min_x": 5, "min_y": 0, "max_x": 5, "max_y": 1}}, "bounds: .*min below max"),
        ({"robots": []}, "robots: "),
        ({"robots": [{"id": "e1", "type": "crane", "home": {"x": 0, "y": 0}}]}, "crane, which robot_types lacks"),
        ({"robots": SMALL["robots"] * 2}, "two robots have the same name"),
        ({"robots": [{"id": "e1", "type": "excavator"}]}, "robots.0.home: Field required"),
        ({"robot_types": {"excavator": {"length_m": -3, "width_m": 2, "max_speed_mps": 1}}}, "length_m: "),
        (
            {"robot_types": {"excavator": {"length_m": 3, "width_m": 2, "max_speed_mps": 1, "skills": ["fly"]}}},
            "names the skill fly, which is in no catalogue",
        ),
        ({"cameras": [{"id": "a", "position": {"x": 0, "y": 0}, "height_m": 9}] * 2}, "two cameras have the same name"),
        (
            {"things": [{"name": "soil1", "class": "soil", "position": {"x": float("nan"), "y": 0}, "radius_m": 1}]},
            "things.0.position.x: ",
        ),
        ({"skills": [{"name": "dump_loading", "verb": "l", "text": "again"}]}, "two skills are named 'dump_loading'"),
    ],
)  # fmt: skip
def test_a_file_that_breaks_a_rule_is_refused_with_the_place(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    """The message names the file, the field and the rule."""
    file = write(tmp_path, **changes)
    with pytest.raises(SiteError, match=said) as caught:
        load_site(file)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize("text", ["a: [", "\x00", "- just\n- a list\n", "", "!!python/object/apply:os.system ['true']"])
def test_a_file_that_is_no_site_is_refused(tmp_path: Path, text: str) -> None:
    """No YAML, no mapping, or tags that would run something: an error, and nothing runs."""
    file = tmp_path / "site.yaml"
    file.write_text(text)
    with pytest.raises(SiteError, match=r"site\.yaml"):
        load_site(file)


def test_a_file_that_is_not_text_or_not_there_is_refused(tmp_path: Path) -> None:
    """The message says which file, and what is wrong with it."""
    with pytest.raises(SiteError, match=r"cannot read the site file .*: No such file"):
        load_site(tmp_path / "none.yaml")
    with pytest.raises(SiteError, match="cannot read the site file"):
        load_site(tmp_path)
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x80")
    with pytest.raises(SiteError, match="is no YAML"):
        load_site(binary)


def test_every_site_of_the_repository_can_be_loaded() -> None:
    """No file in `sites/` is broken."""
    files = sorted((ROOT / "sites").glob("*.yaml"))
    assert files
    assert all(isinstance(load_site(f), Site) for f in files)
