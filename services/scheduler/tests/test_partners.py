"""Who loads whom, as the plan's graph says."""

from muster_scheduler.core.state import Mission
from muster_scheduler.partners import partners_of
from muster_scheduler.testing import Yard, planned
from muster_schemas.plan import PlanTask

E1, E2, E3 = "robot_excavator_01", "robot_excavator_02", "robot_excavator_03"
T1, T2 = "robot_dump_truck_01", "robot_dump_truck_02"
TRUCKS = frozenset({T1, T2, "robot_dump_truck_03"})
GO, DIG, DUMP, LOAD, TIP, HOME = (
    "target_area_for_specific_robots",
    "Excavation",
    "ExcavatorUnloading",
    "DumpLoading",
    "DumpUnloading",
    "return_to_start_for_specific_robots",
)


def pairs(mission: Mission, name: str, *, near: bool = False) -> dict[str, str]:
    """Return the partners of the task of that name."""
    (task,) = [t for t in mission.tasks.values() if t.name == name]
    return partners_of(mission, task, TRUCKS, lambda _a, _b: near)


def test_the_truck_whose_loading_hangs_on_the_same_digging_is_loaded(yard: Yard) -> None:
    """One excavator, two trucks, one after the other: each bucket goes where its loading is."""
    mission = yard.submit(
        planned("go", GO, [E3, T1, T2], objects=["soil2"]),
        planned("dig1", DIG, [E3], after=["go"]),
        planned("dump1", DUMP, [E3], after=["dig1"]),
        planned("load1", LOAD, [T1], after=["dig1"]),
        planned("haul", GO, [T1], after=["load1", "dump1"], objects=["soil1"]),
        planned("dig2", DIG, [E3], after=["dump1"]),
        planned("dump2", DUMP, [E3], after=["dig2"]),
        planned("load2", LOAD, [T2], after=["dig2"]),
        planned("home", HOME, [T2], after=["load2", "dump2"]),
    )
    assert pairs(mission, "dump1") == {E3: T1}
    assert pairs(mission, "dump2") == {E3: T2}
    assert pairs(mission, "load1") == {T1: E3}
    assert pairs(mission, "load2") == {T2: E3}


def test_the_truck_that_leaves_after_the_unloading_is_loaded(yard: Yard) -> None:
    """Without a loading task the truck whose task depends on the unloading takes the load."""
    mission = yard.submit(
        planned("go", GO, [E3, T2], objects=["soil2"]),
        planned("dig", DIG, [E3], after=["go"]),
        planned("dump", DUMP, [E3], after=["dig"]),
        planned("haul", GO, [T2], after=["dump"], objects=["rock1"]),
    )
    assert pairs(mission, "dump") == {E3: T2}


def test_two_teams_do_not_mix(yard: Yard) -> None:
    """Each excavator unloads into the truck that came with it."""

    def team(n: str, excavator: str, truck: str, pile: str) -> tuple[PlanTask, ...]:
        return (
            planned("go" + n, GO, [excavator, truck], objects=[pile]),
            planned("dig" + n, DIG, [excavator], after=["go" + n]),
            planned("dump" + n, DUMP, [excavator], after=["dig" + n]),
        )

    mission = yard.submit(*team("a", E1, T1, "soil1"), *team("b", E2, T2, "soil1"))
    assert pairs(mission, "dumpa") == {E1: T1}
    assert pairs(mission, "dumpb") == {E2: T2}


def test_what_is_put_aside_goes_into_no_truck_that_is_elsewhere(yard: Yard) -> None:
    """A truck that leaves afterwards for another place does not wait for the rock that is put aside."""
    mission = yard.submit(
        planned("go", GO, [E2], objects=["rock1"]),
        planned("dig", DIG, [E2], after=["go"]),
        planned("aside", DUMP, [E2], after=["dig"]),
        planned("pass", GO, [T2], after=["aside"], objects=["soil2"]),
    )
    assert pairs(mission, "aside") == {}


def test_robots_that_the_plan_sends_nowhere_work_together_if_they_stand_near(yard: Yard) -> None:
    """'Dig and empty it into truck 1', both being there already."""
    mission = yard.submit(
        planned("dig", DIG, [E1]), planned("dump", DUMP, [E1], after=["dig"]), planned("tip", TIP, [T1], after=["dump"])
    )
    assert pairs(mission, "dump", near=True) == {E1: T1}
    assert pairs(mission, "dump", near=False) == {}


def test_a_loading_that_nobody_does_has_no_partner(yard: Yard) -> None:
    """The truck then only stands ready."""
    mission = yard.submit(planned("go", GO, [T1], objects=["soil1"]), planned("load", LOAD, [T1], after=["go"]))
    assert pairs(mission, "load") == {}


def test_a_team_of_two_excavators_fills_two_trucks(yard: Yard) -> None:
    """One task of two robots: each gets a truck of its own."""
    mission = yard.submit(
        planned("go", GO, [E1, E2, T1, T2], objects=["soil1"]),
        planned("dig", DIG, [E1, E2], after=["go"]),
        planned("dump", DUMP, [E1, E2], after=["dig"]),
        planned("load", LOAD, [T1, T2], after=["dig"]),
    )
    assert pairs(mission, "dump") == {E1: T1, E2: T2}
    assert pairs(mission, "load") == {T1: E1, T2: E2}
