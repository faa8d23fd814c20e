"""What is looked for."""

import pytest
from muster_schemas.site import Site
from muster_vision.vocabulary import Wishes, class_of


@pytest.mark.parametrize(
    ("keyword", "name"),
    [
        ("puddle3", "puddle"),
        ("Traffic cone 2", "traffic_cone"),
        ("soil_pile_12", "soil_pile"),
        ("crate", "crate"),
        ("7", ""),
        ("../../etc", "etc"),
        ("水", ""),
    ],
)
def test_a_keyword_asks_for_a_class(keyword: str, name: str) -> None:
    """Its number is left out, and what is left can stand in a key."""
    assert class_of(keyword) == name


def test_a_keyword_is_wanted_until_its_time_is_over(yard: Site) -> None:
    """Then only what the site names is looked for."""
    wishes = Wishes(yard)
    wishes.want(["crate2"], until=10.0)
    assert "crate" in wishes.vocabulary(9.0).names
    assert set(wishes.vocabulary(11.0).names) == set(yard.vision.classes)


def test_what_the_map_holds_is_looked_for_as_long_as_it_is_there(yard: Site) -> None:
    """Else an object that was asked for would vanish with the wish."""
    assert "crate" in Wishes(yard).vocabulary(0.0, ["crate", "puddle"]).names


def test_a_class_of_the_site_keeps_the_sites_own_words(yard: Site) -> None:
    """Whoever asks for puddle9 asks for nothing new."""
    wishes = Wishes(yard)
    before = wishes.vocabulary(0.0)
    wishes.want(["puddle9", "Rock 1"], until=10.0)
    assert wishes.vocabulary(0.0) == before
    assert before.classes["rock"] == "a grey rock"


def test_the_sites_robots_are_machines(yard: Site) -> None:
    """They are recognised, and are not put in the map."""
    assert {"excavator", "dump_truck"} <= Wishes(yard).vocabulary(0.0).machines
