"""What the site's words are."""

from dataclasses import replace

import pytest
from muster_planner.surroundings import Surroundings
from muster_planner.testing import YARD

HERE = Surroundings.of_file(YARD)


@pytest.mark.parametrize(
    ("text", "looked_for"),
    [
        ("dig at soil 1", []),
        ("dig at the soil pile", []),
        ("drive to puddle 3", ["puddle3"]),
        ("drive to puddle3 and Puddle no. 4", ["puddle3", "puddle4"]),
        ("the rocks", []),
        ("to rock #2", ["rock2"]),
        ("the third soil pile", ["soil3"]),
        ("a rocket and the soiled rag", []),
        ("go to the crater", ["crater1"]),
        ("go to crater twelve", ["crater12", "crater1"]),
    ],
)
def test_objects_that_the_words_name_and_the_map_lacks_are_looked_for(text: str, looked_for: list[str]) -> None:
    """By class and number; also number 1 of a class that is mentioned."""
    assert replace(HERE, classes=(*HERE.classes, "crater")).to_look_for(text) == looked_for


@pytest.mark.parametrize(
    ("text", "absent"),
    [
        ("Drive truck 1 to puddle 7.", ["puddle 7"]),
        ("the third soil pile, digger 2", ["soil 3"]),
        ("1) all trucks keep off the rock\n2) truck 1 to the rock\n3) truck 1 tips", []),
        ("Soil heap no. 9 and obstacles 1 and 4", ["obstacle 4", "soil 9"]),
        ("Excavator four digs", ["excavator 4"]),
        ("EX-5 and DT7 home", ["dump truck 7", "excavator 5"]),
        ("trucks 1, 2 and 5 go home", ["dump truck 5"]),
        ("robot_dump_truck_04 home", ["dump truck 4"]),
        ("the fourth excavator", ["excavator 4"]),
        ("excavator 2, dump truck 3, puddle 2, the second obstacle", []),
        ("Trucks: 1 at soil 1, 2 at soil 2, 3 at the rock", []),
        ("truck 2 waits at puddle 2 20 minutes", []),
        ("after obstacle 2 3 trucks go home", []),
        ("excavator 1 digs 5 times at soil 1", []),
        ("truck 5, sorry, truck 2 goes home", []),
    ],
)
def test_robots_and_objects_that_are_named_by_number_and_not_there(text: str, absent: list[str]) -> None:
    """They are refused by name; counts, distances, times and what is taken back are not."""
    reasons = HERE.absent(text)
    assert sorted(r.message.split(" on the site")[0].removeprefix("There is no ") for r in reasons) == absent


def test_a_robot_that_is_gone_is_not_replaced_by_another() -> None:
    """Even if its whole type is gone."""
    without = replace(HERE, roster=tuple(c for c in HERE.roster if c.type == "dump_truck"))
    assert [r.code for r in without.absent("excavator 3 digs")] == ["unknown_robot"]


def test_robots_are_no_objects() -> None:
    """The cameras know them too, but nobody drives to a robot."""
    assert set(HERE.classes) == {"puddle", "soil", "obstacle", "rock"}


def test_a_long_list_is_cut() -> None:
    """One instruction cannot have the cameras look for everything."""
    text = " ".join(f"rock {n}" for n in range(2, 200))
    assert len(HERE.to_look_for(text)) == 16
