"""Programs with threads, and the graphs that they mean."""

from textwrap import dedent

import pytest
from muster_planner.evaluation.testing import THERE, case_of, scored
from muster_planner.evaluation.threads import PlanCodeError, read_program
from muster_planner.plan_language import encode
from muster_planner.short_names import SiteNames

NAMES = SiteNames(THERE.roster, THERE.objects, THERE.catalogue, THERE.letters)
GO, HOME = "target_area_for_specific_robots", "return_to_start_for_specific_robots"


def said(program: str) -> list[str]:
    """Return the plan of a program in the plan language."""
    return encode(read_program(dedent(program), THERE.catalogue), NAMES).splitlines()


def test_lines_run_one_after_another() -> None:
    """Each waits for the one before it."""
    assert said(f"""
        {GO}(["robot_excavator_01"], "soil1")
        Excavation(["robot_excavator_01"])
        avoid_areas_for_all_robots(objects=["puddle1", "puddle2"])
    """) == ["a go E1 @ soil1", "b dig E1 < a", "c avoid all @ puddle1 puddle2 < b"]


def test_threads_run_beside_each_other_until_they_are_joined() -> None:
    """What is started waits for what was done before; what follows a join waits for the thread."""
    program = f"""
        import threading
        def load(digger, place):
            "docstring"
            {GO}([digger], place)
            Excavation([digger], place)
        avoid_areas_for_all_robots("puddle1")
        one = threading.Thread(target=load, args=("robot_excavator_01", "soil1"))
        two = threading.Thread(target={HOME}, args=(["robot_dump_truck_01"],))
        one.start()
        two.start()
        one.join()
        {HOME}(robots=robots_of("excavator"))
    """
    assert said(program) == [
        "a avoid all @ puddle1",
        "b go E1 @ soil1 < a",
        "c dig E1 @ soil1 < b",
        "d home T1 < a",
        "e home E* < a c",
    ]
    reference = case_of(
        "a avoid all @ puddle1", "b go E1 @ soil1 < a", "c dig E1 < b", "d home T1 < a", "e home E* < c"
    )
    assert scored(reference, *said(program)).right


def test_loops_over_lists_and_functions_in_functions_are_followed() -> None:
    """As models like to write them."""
    assert said(
        f"""
        from threading import Thread
        def trip(truck):
            def there():
                {GO}([truck], "rock1")
            there()
            {HOME}([truck])
        def main(count=2):
            threads = []
            for truck in ["robot_dump_truck_01", "robot_dump_truck_02"]:
                threads.append(Thread(target=trip, args=(truck,)))
            late = [Thread(target=lambda: Excavation(robots_of("excavator", 1))) for _ in [1]]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            for thread in late:
                thread.start()
        if __name__ == "__main__":
            main()
    """
    ) == [
        "a go T1 @ rock1",
        "b home T1 < a",
        "c go T2 @ rock1",
        "d home T2 < c",
        "e dig E:1 < b d",
    ]


@pytest.mark.parametrize(
    ("program", "why"),
    [
        ("def (", "no Python"),
        ("", "uses no skill"),
        ("x = 1", "uses no skill"),
        ("while True:\n    pass", "line 1: a plan has no while"),
        ("import os\nos.system('true')", "line 2: only skills"),
        ("open('x')", "there is no 'open'"),
        ("Excavation(['robot_excavator_01'] * 1000000)", "a plan has no binop"),
        ("Excavation([1])", "named by strings"),
        ("Excavation(['robot_excavator_01'], 'soil1', 'soil2')", "takes robots and objects"),
        ("Excavation(['robot_excavator_01'], place='soil1')", "takes robots and objects"),
        ("Excavation(['x' * 2])", "a plan has no binop"),
        ("Excavation(['" + "x" * 99 + "'])", "cannot be done with these arguments"),
        ("def f():\n    f()\nf()", "too deeply"),
        ("def f(a):\n    pass\nf()", "the function takes a"),
        ("import threading\nt = threading.Thread()\n", "needs target="),
        ("import threading\nt = threading.Thread(target=print)\n", "there is no 'print'"),
        (f"import threading\nt = threading.Thread(target={HOME}, args=(['r'],))\nt.join()", "before it is started"),
        (f"import threading\nt = threading.Thread(target={HOME}, args=(['r'],))\nt.start()\nt.start()", "once"),
        (f"for n in {list(range(200))}:\n    {HOME}(['r'])", "at most 100 tasks"),
        (f"a = {list(range(50))}\nfor b in a:\n    for c in a:\n        for d in a:\n            pass", "too long"),
        ("(" * 5000, "no Python"),
        ("x = " + "-" * 50_000 + "1", "nested too deeply"),
        ("\0", "no Python"),
    ],
)
def test_a_program_that_is_no_plan_is_refused(program: str, why: str) -> None:
    """With the line and the reason, and without running any of it."""
    with pytest.raises(PlanCodeError, match=r"^line \d+: ") as caught:
        read_program(program, THERE.catalogue)
    assert why in str(caught.value)
