"""All 18 worked cases, as plans, run to their end in the simulator, and no skill starts before what it depends on ends.

The cases run one after another on as few sites as their objects allow, each from a tidy site: rules lifted, robots at
home. What an earlier case removed, a later one on the same site does not name.
"""

import asyncio

import pytest
from muster_bus import open_bus
from muster_schemas.mission import MissionView
from muster_schemas.plan import Plan

from tests.running_site import (
    PLANS,
    Event,
    RunningSite,
    describe,
    order_problems,
    plan_of_case,
    running_site,
    submit,
    succeeded,
    until_ended,
)

SPEED = 8.0
WITHIN_S = 900.0
SITES: tuple[tuple[str, ...], ...] = (
    (
        "A-L1-005", "A-L1-011", "A-L1-013", "A-L2-004", "A-L2-012", "A-L2-018", "B-L1-002", "B-L1-003", "B-L1-021",
        "B-L2-017", "B-L2-019", "A-L3-001", "B-L3-007", "B-L3-015", "B-L2-002", "A-L3-004",
    ),
    ("A-L3-002",),
    ("B-L3-002",),
)  # fmt: skip
"""On the first site, the last two cases pick up obstacle1 and the rock; the others pick up obstacle2."""

TIDY = Plan.model_validate(
    {
        "tasks": [
            {
                "task": "lift_rules",
                "instruction_function": {
                    "name": "allow_areas_for_all_robots",
                    "object_keywords": ["puddle1", "puddle2"],
                },
            },
            {
                "task": "home",
                "instruction_function": {"name": "return_to_start_for_all_robots", "dependencies": ["lift_rules"]},
            },
        ]
    }
)


class Ran:
    """What became of one case."""

    def __init__(self, view: MissionView, history: list[Event]) -> None:
        self.view = view
        self.history = history


async def run_cases(site: RunningSite, names: tuple[str, ...]) -> dict[str, Ran]:
    """Run the cases on a site, one after another, and return what became of each."""
    ran: dict[str, Ran] = {}
    async with open_bus("yard", [site.endpoint]) as bus:
        for name in names:
            mission_id = await submit(bus, f"case {name}", plan_of_case(name))
            view = await until_ended(bus, mission_id, WITHIN_S)
            ran[name] = Ran(view, site.history(mission_id))
            if name != names[-1]:
                tidy = await until_ended(bus, await submit(bus, f"tidy up after {name}", TIDY), WITHIN_S)
                assert succeeded(tidy), describe(tidy)
    return ran


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ran]:
    """Run all cases once."""
    found: dict[str, Ran] = {}
    for names in SITES:
        with running_site(tmp_path_factory.mktemp("site"), speed=SPEED) as site:
            found |= asyncio.run(run_cases(site, names))
            assert site.problems() == []
    return found


def test_no_case_is_left_out() -> None:
    """Every committed plan is run."""
    assert sorted(name for names in SITES for name in names) == sorted(p.stem for p in PLANS.glob("*.json"))


@pytest.mark.end_to_end
@pytest.mark.timeout(5400)
@pytest.mark.parametrize("name", [name for names in SITES for name in names])
def test_a_worked_case_runs_to_its_end_in_order(ran: dict[str, Ran], name: str) -> None:
    """The mission succeeds, each robot does each of its tasks once, and after what the task depends on."""
    case = ran[name]
    assert succeeded(case.view), describe(case.view)
    assert order_problems(case.view, case.history) == []
