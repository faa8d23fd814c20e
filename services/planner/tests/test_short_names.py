"""Robots get short names from the live roster, whatever their ids and types are."""

from collections.abc import Sequence

from muster_planner.embedded import scene_of
from muster_planner.short_names import SiteNames, said_in_words
from muster_schemas.base import Pose
from muster_schemas.robot import RobotCard
from muster_schemas.skills import PAPER_CATALOGUE, Catalogue, Skill

COMMON = tuple(s.name for s in PAPER_CATALOGUE if not s.robot_types)


def card(robot_id: str, robot_type: str, skills: Sequence[str] = ()) -> RobotCard:
    """Return a card of a robot that can do what all can, and `skills`."""
    return RobotCard(
        robot_id=robot_id,
        boot_id="b",
        type=robot_type,
        skills=(*COMMON, *skills),
        home=Pose(x=0, y=0, yaw=0),
        length_m=3,
        width_m=2,
        max_speed_mps=1,
    )


def test_the_number_is_the_one_that_the_id_ends_with() -> None:
    """`robot_dump_truck_07` is T7, also when other numbers are missing."""
    names = SiteNames(
        [card("robot_dump_truck_07", "dump_truck"), card("robot_dump_truck_02", "dump_truck")], [], PAPER_CATALOGUE
    )
    assert names.robot_ids == {"T2": "robot_dump_truck_02", "T7": "robot_dump_truck_07"}


def test_ids_without_numbers_are_counted() -> None:
    """Robots called by a name are numbered in the order of their names."""
    names = SiteNames([card("bravo", "excavator"), card("alpha", "excavator")], [], PAPER_CATALOGUE)
    assert names.robot_ids == {"E1": "alpha", "E2": "bravo"}


def test_equal_numbers_do_not_collide() -> None:
    """Two ids that end with the same number get different short names."""
    names = SiteNames([card("north_1", "excavator"), card("south_1", "excavator")], [], PAPER_CATALOGUE)
    assert sorted(names.robot_ids) == ["E1", "E2"]


def test_types_with_the_same_initial_get_different_letters() -> None:
    """No letter stands for two types; the site's file has the first word."""
    roster = [card("a1", "dump_truck"), card("b1", "tractor"), card("c1", "tank")]
    names = SiteNames(roster, [], PAPER_CATALOGUE, {"tank": "T"})
    assert names.letters["tank"] == "T"
    assert len(set(names.letters.values())) == 3


def test_thirty_types_are_still_told_apart() -> None:
    """Types beyond the alphabet get two letters."""
    names = SiteNames([card(f"r{n}", f"a{n}") for n in range(30)], [], PAPER_CATALOGUE)
    assert len(set(names.letters.values())) == 30


def test_a_new_type_is_seen_with_its_skills() -> None:
    """Robots, objects and verbs that the model can point at come from the roster, the map and the catalogue."""
    compaction = Skill(name="compaction", verb="compact", text="roll the ground", robot_types=("roller",))
    catalogue = Catalogue.with_site([compaction])
    scene = scene_of(SiteNames([card("roller_1", "roller", ["compaction"])], ["ramp1"], catalogue))
    assert [(k.words, k.robots, k.verbs) for k in scene.kinds] == [("roller", ("R1",), ("compact",))]
    assert scene.objects == ("ramp1",)


def test_whole_ids_in_the_text_become_what_people_say() -> None:
    """The model knows robots by their type and number only."""
    names = SiteNames([card("robot_excavator_01", "excavator")], ["soil1"], PAPER_CATALOGUE)
    assert said_in_words("robot_excavator_01 digs at soil1", names) == "excavator 1 digs at soil1"
    assert said_in_words("my_robot_excavator_01 digs", names) == "my_robot_excavator_01 digs"
