"""Who loads whom: the plan does not say it, its graph does. Pure.

An unloading excavator's truck is the one whose own loading hangs on the same digging; else the one whose task depends
most directly on the unloading; else one that came along before it; each only if the plan does not have it elsewhere.
"""

from collections.abc import Callable, Iterator, Mapping

from muster_schemas.mission import TaskStatus

from .core.state import Mission, Task

Near = Callable[[str, str], bool]
"""Whether two robots stand near each other, for those that the plan has sent nowhere."""


def partners_of(mission: Mission, task: Task, trucks: frozenset[str], near: Near) -> dict[str, str]:
    """Return for each robot of a dump or load task its partner; those without one are left out.

    Args:
        mission: with robots bound as far as they are.
        task: an unloading of excavators or a loading of trucks.
        trucks: robots that can be loaded.
        near: see `Near`.

    """
    if task.skill.verb == "dump":
        return _trucks_for(mission, task, trucks, near)
    found: dict[str, str] = {}
    for unloading in mission.tasks.values():
        if unloading.skill.verb == "dump":
            for excavator, truck in _trucks_for(mission, unloading, trucks, near).items():
                if truck in task.robots:
                    later = unloading.state is not TaskStatus.SUCCEEDED or _linked(mission, unloading, task)
                    if later or truck not in found:
                        found.setdefault(truck, excavator)
    return found


def _trucks_for(mission: Mission, unloading: Task, trucks: frozenset[str], near: Near) -> dict[str, str]:
    """Return excavator -> truck for one unloading task, each truck once."""
    if unloading.runs:
        given = {r.robot_id: r.order.partner for r in unloading.runs.values()}
        return {e: t for e, t in given.items() if t is not None}
    pairs: dict[str, str] = {}
    loads = _loads_so_far(mission, unloading)
    for excavator in unloading.robots:
        best: tuple[tuple[int, int, int, int], str] | None = None
        for rank, steps, task in _relatives(mission, unloading):
            for number, truck in enumerate(r for r in task.robots if r in trucks):
                if truck in pairs.values() or not _together(mission, unloading, excavator, truck, near):
                    continue
                score = (rank, steps, loads.get(truck, 0), number)
                if best is None or score < best[0]:
                    best = score, truck
        if best is not None:
            pairs[excavator] = best[1]
    return pairs


def _relatives(mission: Mission, unloading: Task) -> Iterator[tuple[int, int, Task]]:
    """Yield (rank, steps, task): how directly other tasks of the mission hang together with an unloading."""
    later = mission.graph.steps_to(unloading.task_id)
    earlier = mission.graph.steps_from(unloading.task_id)
    for task in mission.tasks.values():
        if task.skill.verb == "load" and _linked(mission, unloading, task):
            yield 0, 0, task
        elif task.task_id in later:
            yield 1, later[task.task_id], task
        elif task.task_id in earlier:
            yield 2, earlier[task.task_id], task
        elif task is not unloading:
            yield 3, 0, task


def _linked(mission: Mission, unloading: Task, loading: Task) -> bool:
    """Return whether a loading belongs to an unloading: one hangs on the other, or both on the same digging."""
    if unloading.task_id in loading.dependencies or loading.task_id in unloading.dependencies:
        return True
    common = set(unloading.dependencies) & set(loading.dependencies)
    return any(mission.tasks[t].skill.verb == "dig" for t in common)


def _loads_so_far(mission: Mission, unloading: Task) -> Mapping[str, int]:
    """Return how many unloadings each truck was given before this one."""
    loads: dict[str, int] = {}
    for task in mission.tasks.values():
        if task is not unloading and task.skill.verb == "dump":
            for run in task.runs.values():
                if run.order.partner is not None:
                    loads[run.order.partner] = loads.get(run.order.partner, 0) + 1
    return loads


def _together(mission: Mission, unloading: Task, excavator: str, truck: str, near: Near) -> bool:
    """Return whether the plan has both at one place when the unloading comes, or they stand near each other anyway."""
    one = _place_before(mission, unloading, excavator)
    other = _place_before(mission, unloading, truck)
    if one is None or other is None:
        return near(excavator, truck)
    return one == other


def _place_before(mission: Mission, unloading: Task, robot_id: str) -> str | None:
    """Return the object that the plan has a robot at when an unloading comes, or None if it sends it nowhere."""
    if robot_id in unloading.robots and unloading.objects:
        return unloading.objects[-1]
    steps = mission.graph.steps_from(unloading.task_id)
    later = mission.graph.steps_to(unloading.task_id)
    places = [
        # a task beside the unloading, such as the truck's own drive to it, counts after those before it
        (steps.get(t.task_id, len(mission.tasks)), t.order[2], t.objects[-1])
        for t in mission.tasks.values()
        if robot_id in t.robots and t.objects and t.skill.verb not in ("avoid", "allow") and t.task_id not in later
    ]
    return min(places)[2] if places else None
