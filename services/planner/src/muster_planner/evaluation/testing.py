"""Testing support: plans and cases in few words."""

from muster_schemas.plan import Plan

from muster_planner.plan_language import Refusal, decode
from muster_planner.short_names import SiteNames
from muster_planner.surroundings import Surroundings
from muster_planner.testing import YARD

from .cases import Case, reference_case
from .fleet import Fleet
from .scoring import Score, score

THERE = Surroundings.of_file(YARD)
FLEET = Fleet.of(THERE.roster)
NAMES = SiteNames(THERE.roster, THERE.objects, THERE.catalogue, THERE.letters)


def plan(*lines: str) -> Plan:
    """Return the plan that lines of the plan language say."""
    read = decode("\n".join(lines), NAMES)
    assert not isinstance(read, Refusal)  # noqa: S101 (testing support)
    return read


def case_of(*lines: str) -> Case:
    """Return the case whose reference is this plan."""
    return reference_case(plan(*lines), FLEET, THERE.catalogue, said=Case("case", "L1", "text"))


def scored(case: Case, *lines: str) -> Score:
    """Return the score of a plan for a case."""
    return score(case, plan(*lines), FLEET, THERE.catalogue)
