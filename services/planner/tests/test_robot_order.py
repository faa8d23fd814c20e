"""A robot does one thing at a time."""

from pathlib import Path

import pytest
from muster_planner.plan_language import Refusal, decode, encode
from muster_planner.robot_order import one_thing_at_a_time
from muster_planner.short_names import SiteNames
from muster_planner.surroundings import Surroundings
from muster_schemas.site import load_site

YARD = Surroundings.of_file(load_site(Path(__file__).resolve().parents[3] / "sites" / "yard.yaml"))
NAMES = SiteNames(YARD.roster, YARD.objects, YARD.catalogue, YARD.letters)


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("a go E1 @ soil1\nb dig E1 @ soil1", "a go E1 @ soil1\nb dig E1 @ soil1 < a"),
        ("a go E1 @ soil1\nb go E2 @ soil1", "a go E1 @ soil1\nb go E2 @ soil1"),
        ("a go T* @ soil1\nb home T2", "a go T* @ soil1\nb home T2 < a"),
        ("a go T:2 @ soil1\nb tip T:2\nc home E1", "a go T:2 @ soil1\nb tip T:2 < a\nc home E1"),
        ("a go E1 @ soil1\nb dig E1 < a\nc home E1 < b", "a go E1 @ soil1\nb dig E1 < a\nc home E1 < b"),
        ("a avoid E1 @ soil1\nb go E1 @ rock1", "a avoid E1 @ soil1\nb go E1 @ rock1"),
        ("a go E1 @ soil1\nb home all", "a go E1 @ soil1\nb home all < a"),
        ("a home E2 < b\nb go E2 @ rock1", "a home E2 < b\nb go E2 @ rock1"),
    ],
)
def test_a_robots_tasks_wait_for_each_other(said: str, meant: str) -> None:
    """Driving and work of one robot are in a row; rules, other robots and plans in another order stay as said."""
    plan = decode(said, NAMES)
    assert not isinstance(plan, Refusal)
    assert encode(one_thing_at_a_time(plan, NAMES), NAMES) == meant
