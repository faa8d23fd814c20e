"""What the scheduler's core costs: per event with few and with very many open tasks, per task, and per large mission.

Costs are processor time and memory of a fresh process for each row, so other work on the machine matters little.
"""

import gc
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, TypeVar

from muster_scheduler.rpc import check
from muster_scheduler.testing import Yard, planned, yard_file
from muster_schemas.plan import Plan, PlanTask
from muster_schemas.robot import SkillStatusKind
from muster_schemas.site import load_site

FEW, MANY = 100, 100_000
MISSION_TASKS: Final = 100
PROBE_TASKS: Final = 500
RATIO_BAR: Final = 1.5
SITE: Final = load_site(yard_file())
ROBOTS: Final = ("robot_excavator_01", "robot_excavator_02", "robot_excavator_03")
LARGE_TASKS: Final = 10_000
"""Of one mission; a plan over the bus has at most 100, the core has no limit."""
PAGE_BYTES: Final = resource.getpagesize()

T = TypeVar("T")


def measure() -> list[dict[str, Any]]:
    """Return the cost of an event with many open tasks over that with few, events a second, memory, a large mission."""
    many, task_bytes = _in_fresh_process(_crowded, MANY)
    few, _ = _in_fresh_process(_crowded, FEW)
    submit_s, gate_s, run_s = _in_fresh_process(_large, LARGE_TASKS)
    return [
        _row("event_cost_ratio_100k", many / few, "x", RATIO_BAR),
        _row("events_per_s", 1 / many, "1/s"),
        _row("task_memory_kb", task_bytes / 1024, "kB"),
        _row("mission_10k_gate_s", gate_s, "s"),
        _row("mission_10k_submit_s", submit_s, "s"),
        _row("mission_10k_run_s", run_s, "s"),
    ]


def _row(name: str, value: float, unit: str, bar: float | None = None) -> dict[str, Any]:
    return {"name": name, "value": round(value, 3), "unit": unit, "bar": bar, "ok": bar is None or value <= bar}


def _in_fresh_process(function: Callable[[int], T], argument: int) -> T:
    with ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn")) as process:
        return process.submit(function, argument).result()


def _crowded(open_tasks: int) -> tuple[float, float]:
    """Return what an event of one urgent mission costs while so many tasks of others wait, and what each of them takes.

    Returns:
        mean processor time of an event in seconds; resident memory of an open task with its plan in bytes.

    """
    yard = Yard(SITE, check=False)
    yard.open()
    before = _resident_bytes()
    for number in range(open_tasks // MISSION_TASKS):
        robot = ROBOTS[number % len(ROBOTS)]
        chain = [
            planned(f"n{i}", "Excavation", [robot], [f"n{i - 50}"] if i >= 50 else []) for i in range(MISSION_TASKS)
        ]
        yard.submit(*chain)
    task_bytes = (_resident_bytes() - before) / open_tasks
    yard.robot_comes("robot_excavator_01")  # its first task was never seen by this life, so it is given back
    names = [f"p{i}" for i in range(PROBE_TASKS)]
    probe = yard.submit(
        *(planned(n, "Excavation", [ROBOTS[0]], names[max(i - 1, 0) : i]) for i, n in enumerate(names)), priority=9
    )
    holder = yard.core.state.robots[ROBOTS[0]].holder
    if holder is None:
        raise RuntimeError("the robot of the measurement is idle")
    first = yard.core.state.missions[holder[0]].tasks[holder[1]]
    yard.say(ROBOTS[0], first, SkillStatusKind.SUCCEEDED)
    events_before = len(yard.events)
    gc.collect()  # what setting up left behind is no cost of the events
    begun = time.process_time()
    for task in probe.tasks.values():
        yard.say(ROBOTS[0], task, SkillStatusKind.STARTED)
        yard.say(ROBOTS[0], task, SkillStatusKind.SUCCEEDED)
    cost = time.process_time() - begun
    if not yard.ended_well(probe):
        raise RuntimeError("the mission that was measured did not succeed")
    return cost / (len(yard.events) - events_before), task_bytes


def _resident_bytes() -> int:
    gc.collect()
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * PAGE_BYTES


def _large(count: int) -> tuple[float, float, float]:
    """Return the processor seconds to submit, to check and to run one mission of so many tasks, each after two."""
    yard = Yard(SITE, check=False)
    yard.open()
    tasks = tuple(_layered(number) for number in range(count))
    begun = time.process_time()
    reasons = check(yard.core, Plan.model_construct(tasks=tasks), most=count)
    checked = time.process_time()
    if reasons:
        raise RuntimeError(f"the gate refused the mission: {reasons[0].message}")
    mission = yard.submit(*tasks)
    submitted = time.process_time()
    while mission.active:
        for task_id in sorted(mission.active):
            task = mission.tasks[task_id]
            yard.all_say(task, SkillStatusKind.STARTED)
            yard.all_say(task, SkillStatusKind.SUCCEEDED)
    ended = time.process_time()
    if not yard.ended_well(mission):
        raise RuntimeError("the mission that was measured did not succeed")
    return submitted - checked, checked - begun, ended - submitted


def _layered(number: int) -> PlanTask:
    """Return a task of a wide graph: as many side by side as there are robots, each after two of the layer before."""
    width = len(ROBOTS)
    layer, place = divmod(number, width)
    before = [f"n{(layer - 1) * width + (place + k) % width}" for k in range(2)] if layer else []
    return planned(f"n{number}", "Excavation", [ROBOTS[place]], before)


if __name__ == "__main__":
    for row in measure():
        print(row)
