"""How missions look in a terminal."""

from io import StringIO

from muster_cli.views import bars, elapsed, mission_table, missions_table, plan_table, seconds
from muster_schemas.mission import MissionState, MissionStatus, MissionView, TaskState, TaskStatus
from muster_schemas.plan import InstructionFunction, Plan, PlanTask
from rich.console import Console, RenderableType


def shown(what: RenderableType) -> str:
    """Return what stands in a terminal of 140 columns."""
    out = StringIO()
    Console(file=out, width=140, color_system=None).print(what)
    return out.getvalue()


def task(task_id: str, state: TaskStatus, began: float | None, ended: float | None, **rest: object) -> TaskState:
    """Return a task of one mission."""
    fields = {"mission_id": "m-1", "task_id": task_id, "revision": 1, "name": "dig"}
    fields |= {"skill": "excavator_digging", "robots": ("robot_excavator_01",), "objects": ("soil1",)}
    return TaskState.model_validate(fields | {"state": state, "started_at": began, "ended_at": ended} | rest)


def mission(state: MissionStatus, *tasks: TaskState) -> MissionView:
    """Return a mission that began at 100 s."""
    head = MissionState(mission_id="m-1", revision=1, text="dig [bold]there", state=state, created_at=100)
    return MissionView(mission=head, tasks=tasks)


def test_a_waiting_task_says_what_for() -> None:
    """The reason stands in its line, and nothing in a text is taken for markup."""
    text = shown(
        mission_table(
            mission(
                MissionStatus.RUNNING,
                task("t1", TaskStatus.RUNNING, 101, None, progress=0.4),
                task("t2", TaskStatus.WAITING, None, None, waiting_for=("dependency: t1",)),
            ),
            now=166,
        )
    )
    assert "dig [bold]there" in text
    assert "dependency: t1" in text
    assert "1 min 05 s" in text
    assert "40% done" in text


def test_an_error_stands_in_place_of_what_it_waits_for() -> None:
    """A failed task says why."""
    text = shown(mission_table(mission(MissionStatus.FAILED, task("t1", TaskStatus.FAILED, 1, 2, error="no soil"))))
    assert "no soil" in text


def test_bars_show_parallel_work() -> None:
    """Tasks that ran at the same time have bars above each other, later ones begin further right."""
    lines = shown(
        bars(
            [
                task("t1", TaskStatus.SUCCEEDED, 0, 50),
                task("t2", TaskStatus.SUCCEEDED, 0, 100),
                task("t3", TaskStatus.SUCCEEDED, 50, 100),
                task("t4", TaskStatus.SKIPPED, None, None),
            ]
        )
    ).splitlines()[1:]
    assert [line.count("━") for line in lines] == [24, 48, 24]
    starts = [line.index("━") for line in lines]
    assert starts[0] == starts[1] == starts[2] - 24


def test_nothing_that_ran_makes_no_bars() -> None:
    """A rejected mission has an empty timeline."""
    assert "━" not in shown(bars([]))


def test_missions_count_their_tasks() -> None:
    """The list says how many tasks are done."""
    view = mission(
        MissionStatus.RUNNING, task("t1", TaskStatus.SUCCEEDED, 1, 2), task("t2", TaskStatus.READY, None, None)
    )
    assert "1 of 2" in shown(missions_table([view]))


def test_a_plan_shows_selectors() -> None:
    """Robots by type and the whole fleet are named as such."""
    by_type = InstructionFunction(name="Excavation", robot_type=("excavator",), robot_count=2)
    everyone = InstructionFunction(name="return_to_start_for_all_robots", dependencies=("a",))
    plan = Plan(
        tasks=(PlanTask(task="a", instruction_function=by_type), PlanTask(task="b", instruction_function=everyone))
    )
    text = shown(plan_table(plan))
    assert "2 excavator" in text
    assert "home (all)" in text
    assert text.splitlines()[-1].split()[-1] == "t1"


def test_time_spans() -> None:
    """Short ones in seconds, long ones in minutes, none for what has not begun."""
    assert (seconds(48.9), seconds(125)) == ("48 s", "2 min 05 s")
    assert (elapsed(None, None, 5.0), elapsed(1.0, 4.0, 9.0), elapsed(1.0, None, 9.0)) == ("", "3 s", "8 s")
