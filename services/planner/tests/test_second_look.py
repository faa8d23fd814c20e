"""Of several likely answers, the one that uses what the instruction names is taken."""

from muster_planner.pointer.choices import Writing, choices_of
from muster_planner.pointer.search import Found
from muster_planner.second_look import ranked

from .pointer.yard import NAMES, SCENE

Line = tuple[str, list[str], list[str], list[int]]


def found(score: float, *lines: Line) -> Found:
    """Return an answer with these lines."""
    writing = Writing(SCENE)
    choices = choices_of(lines, SCENE)
    for choice in choices:
        writing = writing.after(choice)
    return Found(writing, score, len(choices))


def best(text: str, *answers: Found) -> str:
    """Return what the first of the ranked answers says."""
    return ranked(answers, text, NAMES)[0].writing.said()


HOME: Line = ("home", ["T1"], [], [])
BOTH: Line = ("home", ["T1", "T2"], [], [])


def test_a_robot_that_is_named_is_not_left_out() -> None:
    """A little likelier is not enough."""
    assert best("Truck 1 and truck 2 go home.", found(-0.5, HOME), found(-1.5, BOTH)) == "a home T1 T2"


def test_a_much_likelier_answer_wins_all_the_same() -> None:
    """The look is a doubt, not a rule: a robot may be named only to say that it stays."""
    assert best("Truck 1 goes home, truck 2 stays.", found(-0.1, HOME), found(-6.0, BOTH)) == "a home T1"


def test_a_thing_that_is_named_is_not_left_out() -> None:
    """Objects count as robots do."""
    near = found(-0.5, ("avoid", ["all"], ["puddle1"], []))
    whole = found(-1.5, ("avoid", ["all"], ["puddle1", "puddle2"], []))
    assert best("Everyone avoids puddle 1 and puddle 2.", near, whole) == "a avoid all @ puddle1 puddle2"


def test_all_and_types_use_each_of_their_robots() -> None:
    """`T*` leaves no truck out."""
    fleet = found(-0.5, ("home", ["T*"], [], []))
    assert best("Trucks 1, 2 and 3 go home.", fleet, found(-1.0, HOME)) == "a home T*"


def test_a_line_said_twice_costs() -> None:
    """People ask for a thing once."""
    go: Line = ("go", ["E2"], ["obstacle1"], [])
    again: Line = ("go", ["E2"], ["obstacle1"], [0])
    assert best("Excavator 2 to obstacle 1.", found(-0.4, go, again), found(-1.6, go)) == "a go E2 @ obstacle1"


def test_a_text_that_takes_something_back_may_leave_it_out() -> None:
    """Of "truck 1, sorry, truck 2" only one is meant."""
    second: Line = ("home", ["T2"], [], [])
    text = "Truck 1, sorry, I mean truck 2 goes home."
    assert best(text, found(-0.5, second), found(-1.0, BOTH)) == "a home T2"
