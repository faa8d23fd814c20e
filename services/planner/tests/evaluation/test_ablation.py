"""What is left of a plan's order without its dependencies."""

from muster_planner.evaluation.ablation import Reading, without_dependencies
from muster_planner.evaluation.testing import FLEET, plan

HAUL = plan("a go E1 T1 @ soil1", "b dig E1 < a", "c dump E1 < b", "d go T1 @ puddle1 < c", "e home T:2 < d")


def waits(reading: Reading) -> list[list[int]]:
    """Return for each task the places of those that it waits for."""
    tasks = without_dependencies(HAUL, FLEET, reading).tasks
    place = {t.task: n for n, t in enumerate(tasks)}
    return [[place[d] for d in t.instruction_function.dependencies] for t in tasks]


def test_in_queues_each_robot_keeps_its_own_order() -> None:
    """Two trucks of unknown number are a queue of their own."""
    assert waits(Reading.QUEUES) == [[], [0], [1], [0], []]


def test_in_a_list_everything_waits_for_the_line_before() -> None:
    """Whoever does it."""
    assert waits(Reading.LIST) == [[], [0], [1], [2], [3]]


def test_nothing_else_of_the_plan_changes() -> None:
    """Tasks, skills, robots, objects and their order."""
    for reading in Reading:
        for old, new in zip(HAUL.tasks, without_dependencies(HAUL, FLEET, reading).tasks, strict=True):
            function = new.instruction_function.model_copy(update={"dependencies": ()})
            assert function == old.instruction_function.model_copy(update={"dependencies": ()})
