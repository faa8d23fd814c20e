"""Which state of the site a case wants, and what is noticed when it is another one."""

import pytest
from muster_bus.testing import SITE_FILE
from muster_planner.evaluation.cases import Case, reference_case, short_plan
from muster_planner.evaluation.fleet import Fleet
from muster_planner.plan_language import Refusal
from muster_planner.short_names import SiteNames
from muster_planner.surroundings import Surroundings
from muster_schemas.base import Point
from muster_schemas.robot import Load
from muster_schemas.sim import SimBody, SimWorld, SoilDeposit
from muster_schemas.site import load_site
from muster_schemas.world import AreaRule, AreaRules

from benchmarks.goals import HOME, SOIL, Goal, goal_of, unmet

YARD = load_site(SITE_FILE)
THERE = Surroundings.of_file(YARD)
FLEET = Fleet.of(THERE.roster)
NAMES = SiteNames(THERE.roster, THERE.objects, THERE.catalogue, THERE.letters)
PLACES = {t.name: t.position for t in YARD.things}
E1, E2, T1, T2 = "robot_excavator_01", "robot_excavator_02", "robot_dump_truck_01", "robot_dump_truck_02"


def goal(said: str) -> Goal:
    """Return the goal of a case with this reference, in the short notation."""
    plan = short_plan(said, NAMES)
    assert not isinstance(plan, Refusal)
    return goal_of(reference_case(plan, FLEET, THERE.catalogue, said=Case("case", "L1", "text")), YARD)


def world(
    *, at: dict[str, str] | None = None, loads: dict[str, Load] | None = None, soil: tuple[SoilDeposit, ...] = (),
    without: tuple[str, ...] = (), dug_m3: float = 0.0,
) -> SimWorld:  # fmt: skip
    """Return a site with robots at home but for those `at` objects, and soil1 less what was dug."""
    robots = {
        r.id: SimBody(
            pose=_beside(PLACES[at[r.id]]) if at and r.id in at else r.home,
            load=(loads or {}).get(r.id, Load()),
        )
        for r in YARD.robots
    }
    piles = [
        SoilDeposit(position=t.position, soil_m3=t.soil_m3 - dug_m3 * (t.name == "soil1"), pile=t.name)
        for t in YARD.things
        if t.soil_m3
    ]
    things = {t.name: SimBody(pose=_pose(t.position)) for t in YARD.things if not t.soil_m3 and t.name not in without}
    return SimWorld(
        site_time_s=1, speed_factor=1, achieved_factor=1, robots=robots, things=things, soil=(*piles, *soil),
        robot_contacts=0,
    )  # fmt: skip


def _pose(at: Point):
    return YARD.robots[0].home.model_copy(update={"x": at.x, "y": at.y})


def _beside(at: Point):
    return YARD.robots[0].home.model_copy(update={"x": at.x + 3.0, "y": at.y - 2.0})


def missed(said: str, after: SimWorld, *rules: AreaRule) -> list[str]:
    """Return what is not as the case wants it."""
    return unmet(goal(said), YARD, FLEET, world(), after, AreaRules(revision=1, rules=rules))


HAUL = "1 go E1 T1 @ soil1 | 2 dig E1 < 1 | 3 dump E1 < 2 | 4 go T1 @ puddle1 < 3 | 5 tip T1 < 4"
TIPPED = SoilDeposit(position=Point(x=-9, y=-10), soil_m3=0.5)


def test_soil_that_is_hauled_ends_where_it_is_tipped() -> None:
    """The pile has less, the truck is empty, a heap lies there, and everyone stands where they were sent last."""
    wanted = goal(HAUL)
    assert wanted.places == {E1: "soil1", T1: "puddle1"}
    assert wanted.loads == {E1: None, T1: None}
    assert (wanted.dug, wanted.heaped, wanted.gone) == ({"soil1"}, {"puddle1"}, set())
    done = world(at={E1: "soil1", T1: "puddle1"}, dug_m3=0.5, soil=(TIPPED,))
    assert missed(HAUL, done) == []


@pytest.mark.parametrize(
    ("after", "says"),
    [
        (world(at={E1: "soil1"}, dug_m3=0.5, soil=(TIPPED,)), f"{T1} is not at puddle1"),
        (world(at={E1: "soil1", T1: "puddle1"}, soil=(TIPPED,)), "soil1 has lost no soil"),
        (world(at={E1: "soil1", T1: "puddle1"}, dug_m3=0.5), "no soil was left at puddle1"),
        (world(at={E1: "soil1", T1: "puddle1", T2: "rock1"}, dug_m3=0.5, soil=(TIPPED,)), f"{T2} is not at home"),
        (
            world(at={E1: "soil1", T1: "puddle1"}, dug_m3=0.5, soil=(TIPPED,), without=("rock1",)),
            "rock1 was moved",
        ),
    ],
)
def test_each_difference_is_named(after: SimWorld, says: str) -> None:
    """Also of robots and things that the instruction does not speak of."""
    assert missed(HAUL, after) == [says]


def test_what_is_cleared_is_in_the_bucket() -> None:
    """Until it is put aside."""
    clear = "1 go E2 @ rock1 | 2 dig E2 < 1"
    assert goal(clear).loads == {E2: "rock1"}
    assert goal(clear + " | 3 dump E2 < 2").loads == {E2: None}
    holding = world(at={E2: "rock1"}, loads={E2: Load(bodies=("rock1",))}, without=("rock1",))
    assert missed(clear, holding) == []
    assert f"{E2} holds" in missed(clear, world(at={E2: "rock1"}, without=("rock1",)))[0]
    assert "rock1 is still there" in missed(clear, world(at={E2: "rock1"}, loads={E2: Load(bodies=("rock1",))}))


def test_a_loaded_truck_stays_loaded() -> None:
    """The one that takes on the load beside the unloading, of two that are there."""
    two = (
        "1 go E1 T1 T2 @ soil1 | 2 dig E1 < 1 | 3 dump E1 < 2 | 4 load T2 < 2 | 5 dig E1 < 3 | 6 dump E1 < 5 "
        "| 7 load T1 < 5 | 8 home T2 < 3 4"
    )
    assert goal(two).loads == {E1: None, T1: SOIL, T2: SOIL}
    assert goal(two).places[T2] == HOME
    assert goal("1 go E1 T1 T2 @ soil1 | 2 dig E1 < 1 | 3 dump E1 < 2 | 4 load T2 < 2").loads[T2] == SOIL


def test_rules_that_must_hold_are_those_that_hold() -> None:
    """No more, no fewer."""
    rule = AreaRule(robot_id=T1, object_name="puddle1", centre=PLACES["puddle1"], radius_m=2)
    assert missed("1 avoid T1 @ puddle1", world(), rule) == []
    assert missed("1 avoid T1 @ puddle1", world()) == [f"the rule ('{T1}', 'puddle1') is missing"]
    assert missed("1 avoid T1 @ puddle1 | 2 allow T1 @ puddle1 < 1", world(), rule) == [
        f"the rule ('{T1}', 'puddle1') holds"
    ]


def test_robots_that_are_left_open_may_be_any() -> None:
    """Two trucks are any two, but two."""
    both = "1 go T:2 @ rock1"
    assert missed(both, world(at={T1: "rock1", T2: "rock1"})) == []
    assert missed(both, world(at={T2: "rock1", "robot_dump_truck_03": "rock1"})) == []
    assert len(missed(both, world(at={T2: "rock1"}))) == 1
