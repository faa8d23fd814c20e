"""A refusal is not taken at its word when the site shows that it is wrong."""

from pathlib import Path

import pytest
from muster_planner.false_refusals import is_contradicted
from muster_planner.short_names import SiteNames
from muster_planner.surroundings import Surroundings
from muster_schemas.site import load_site

YARD = Surroundings.of_file(load_site(Path(__file__).resolve().parents[3] / "sites" / "yard.yaml"))
NAMES = SiteNames(YARD.roster, YARD.objects, YARD.catalogue, YARD.letters)


@pytest.mark.parametrize(
    "reason",
    [
        "there is no truck 2 here",
        "there is no excavator 3",
        "There is no dump truck 1 here",
        "there is no puddle 2 here",
    ],
)
def test_what_is_there_cannot_be_called_absent(reason: str) -> None:
    """Robots of the roster and objects of the map are known to be there."""
    assert is_contradicted(reason, NAMES)


@pytest.mark.parametrize(
    "reason",
    [
        "there is no truck 7 here",
        "there is no rock 2",
        "there is no crane 1 here",
        "there are no cranes here",
        "a dump truck cannot dig",
        "small talk, no instruction",
        "there is no truck 2 and there is no truck 9 here",
        "",
    ],
)
def test_other_reasons_stand(reason: str) -> None:
    """What is indeed absent, and every other kind of reason, is left to the model."""
    assert not is_contradicted(reason, NAMES)
