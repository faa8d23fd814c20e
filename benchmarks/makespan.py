"""How much longer the crew takes than it would have to: the live scheduler against the optimum of CP-SAT.

100 random sets of missions, seeded: named robots, pairs, selectors by type and count, up to three missions at once. The
whole core with its policy decides event by event, in its usual budget, while drives and skills take the model's time;
CP-SAT knows everything beforehand and has as long as it wants up to `SOLVER_S`.
"""

import heapq
import random
import statistics
import time
from typing import Any, Final

from muster_scheduler.core.events import MissionSubmitted, Tick
from muster_scheduler.core.state import Task
from muster_scheduler.policy.durations import Durations
from muster_scheduler.policy.outlook import Question, ask
from muster_scheduler.policy.problem import HOME, Problem
from muster_scheduler.policy.search import Limits
from muster_scheduler.testing import Yard, planned, yard_file
from muster_schemas.base import Pose
from muster_schemas.plan import PlanTask
from muster_schemas.robot import SkillStatusKind
from muster_schemas.site import load_site
from ortools.sat.python import cp_model

INSTANCES: Final = 100
BAR: Final = 1.05
SOLVER_S: Final = 10.0
TENTHS: Final = 10
"""The solver counts whole tenths of a second, rounded down, so its optimum is never too long."""
SITE: Final = load_site(yard_file())
EXCAVATORS = [r.id for r in SITE.robots if r.type == "excavator"]
TRUCKS = [r.id for r in SITE.robots if r.type == "dump_truck"]
THINGS = [t.name for t in SITE.things]
GO, COME_HOME = "target_area_for_specific_robots", "return_to_start_for_specific_robots"


def measure(instances: int = INSTANCES, solver_s: float = SOLVER_S) -> list[dict[str, Any]]:
    """Return mean and greatest makespan over the optimum, and how many were as short as they can be."""
    ratios: list[float] = []
    proven = 0
    for seed in range(instances):
        yard, question = instance(seed)
        best_s, is_optimal = optimum(question.problem, solver_s)
        taken_s = live(yard, question)
        ratios.append(taken_s / (best_s if is_optimal else min(best_s, taken_s)))
        proven += is_optimal
    mean = statistics.mean(ratios)
    rows = [
        ("makespan_over_optimum", mean, "x", BAR, mean <= BAR),
        ("makespan_over_optimum_max", max(ratios), "x", None, True),
        ("makespan_share_optimal", sum(r < 1.005 for r in ratios) / instances, "", None, True),
        ("makespan_share_proven", proven / instances, "", None, True),
    ]
    return [{"name": n, "value": round(v, 4), "unit": u, "bar": b, "ok": ok} for n, v, u, b, ok in rows]


def instance(seed: int) -> tuple[Yard, Question]:
    """Return a site where some missions have just been submitted, and the whole question that they pose."""
    rng = random.Random(seed)
    # the budget is counted in processor time, so that what else the machine does changes nothing
    yard = Yard(SITE, check=False, limits=Limits(clock=time.thread_time))
    yard.open()
    for robot in SITE.robots:
        yard.world.poses[robot.id] = Pose(x=rng.uniform(-28, 28), y=rng.uniform(-20, 20), yaw=0)
    missions = [f"m{n}" for n in range(rng.choice([1, 2, 3]))]
    for mission_id in missions:
        event = MissionSubmitted(at=yard.now, mission_id=mission_id, text="do it", tasks=tuple(_plan(rng)))
        # all at once: nothing is decided before the last of them is known
        yard.core.handle(event)
        yard.events.append(event)
    question = ask(yard.core.state, yard.world, Durations(), missions, yard.now)
    if len(question.tasks) != sum(len(yard.core.state.missions[m].tasks) for m in missions):
        raise RuntimeError("the question leaves tasks out")
    return yard, question


def _plan(rng: random.Random) -> list[PlanTask]:
    tasks: list[PlanTask] = []
    for number in range(rng.randint(3, 6)):
        after = [t.task for t in tasks if rng.random() < 0.35][-2:]
        crew, kind = rng.choice([(EXCAVATORS, "excavator"), (TRUCKS, "dump_truck")])
        work = ["Excavation", "ExcavatorUnloading"] if crew is EXCAVATORS else ["DumpLoading", "DumpUnloading"]
        things = [rng.choice(THINGS)]
        who = rng.random()
        if who < 0.35:
            skill = rng.choice([GO, COME_HOME, *work])
            tasks.append(planned(f"n{number}", skill, [rng.choice(crew)], after, objects=_for(skill, things)))
        elif who < 0.55:
            skill = rng.choice([GO, GO, COME_HOME])
            pair = [rng.choice(EXCAVATORS), rng.choice(TRUCKS)]
            tasks.append(planned(f"n{number}", skill, pair, after, objects=_for(skill, things)))
        else:
            skill, count = rng.choice([GO, *work]), rng.choice([1, 1, 2])
            tasks.append(planned(f"n{number}", skill, (), after, objects=things, types=[kind], count=count))
    return tasks


def _for(skill: str, things: list[str]) -> list[str]:
    return [] if skill == COME_HOME else things


def live(yard: Yard, question: Question) -> float:
    """Return the seconds until the last task has ended, with the scheduler deciding as it goes."""
    problem, begun_at = question.problem, yard.now
    numbers = {t.key: n for n, t in enumerate(question.tasks)}
    robots = {robot_id: n for n, robot_id in enumerate(problem.robot_ids)}
    at = list(problem.at)
    ends: list[tuple[float, str, str]] = []
    going: set[tuple[str, str]] = set()
    yard.happen(Tick(at=yard.now))
    while True:
        for task in _active(yard):
            if task.key not in going:
                going.add(task.key)
                yard.all_say(task, SkillStatusKind.STARTED)
                number, drive = numbers[task.key], 0.0
                for robot in (robots[r] for r in task.robots):
                    seconds, at[robot] = problem.drive(robot, at[robot], number)
                    drive = max(drive, seconds)
                heapq.heappush(ends, (yard.now + drive + problem.jobs[number].work_s, *task.key))
        deadline = yard.core.next_deadline()
        if not ends:
            if all(m.state.ended for m in yard.core.state.missions.values()):
                return yard.now - begun_at
            if deadline is None:
                raise RuntimeError("the scheduler has come to a standstill")
        if deadline is not None and (not ends or deadline < ends[0][0]):
            yard.wait(max(deadline - yard.now, 0.0))
            continue
        end, mission_id, task_id = heapq.heappop(ends)
        yard.now = end
        task = yard.core.state.missions[mission_id].tasks[task_id]
        for run in task.runs.values():
            yard.world.poses[run.robot_id] = run.order.goals[-1] if run.order.goals else yard.world.poses[run.robot_id]
        yard.all_say(task, SkillStatusKind.SUCCEEDED)


def _active(yard: Yard) -> list[Task]:
    return [m.tasks[t] for m in yard.core.state.missions.values() for t in sorted(m.active)]


def optimum(problem: Problem, seconds: float) -> tuple[float, bool]:
    """Return the shortest makespan that CP-SAT finds, in seconds, and whether it has shown that there is no shorter."""
    model = cp_model.CpModel()
    jobs = problem.jobs
    longest = max(s for t in problem.travel_s for row in t for s in row)
    horizon = int(sum((longest + j.work_s) * TENTHS + 1 for j in jobs))
    starts = [model.new_int_var(0, horizon, f"start{n}") for n in range(len(jobs))]
    ends = [model.new_int_var(0, horizon, f"end{n}") for n in range(len(jobs))]
    makespan = model.new_int_var(0, horizon, "makespan")
    takes = [int(j.work_s * TENTHS) for j in jobs]
    for number, job in enumerate(jobs):
        model.add(ends[number] >= starts[number] + takes[number])
        model.add(makespan >= ends[number])
        for other in job.after:
            model.add(starts[number] >= ends[other])
    chosen: dict[tuple[int, int], Any] = {}
    for number, choice in enumerate(problem.choices):
        pool = sorted({r for p in choice.pools for r in p})
        chosen |= {(number, r): model.new_bool_var(f"choice{number},{r}") for r in pool}
        model.add(sum(chosen[number, r] for r in pool) == len(choice.pools))
    for robot in range(len(problem.robot_ids)):
        does: dict[int, Any] = {}
        for number, job in enumerate(jobs):
            if robot in job.robots:
                does[number] = True
            elif job.choice is not None and (job.choice, robot) in chosen:
                does[number] = chosen[job.choice, robot]
        _route(model, problem, robot, does, starts, ends)
    model.minimize(makespan)
    solver = cp_model.CpSolver()
    solver.parameters.max_time_in_seconds = seconds
    solver.parameters.num_workers = 2
    solver.parameters.random_seed = 1
    status = solver.solve(model)
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        raise RuntimeError(f"CP-SAT found nothing: {solver.status_name(status)}")
    return solver.objective_value / TENTHS, status == cp_model.OPTIMAL


def _route(model: Any, problem: Problem, robot: int, does: dict[int, Any], starts: list[Any], ends: list[Any]) -> None:
    """Have a robot do its jobs one after the other: a circuit from where it is now (node 0) through them."""
    idle = model.new_bool_var(f"idle{robot}")
    arcs = [(0, 0, idle)]
    for number, done in does.items():
        stop = problem.jobs[number].stops[-1]
        after = problem.homes[robot] if stop == HOME else stop
        follows = [(0, problem.at[robot], number)] + [(number + 1, after, n) for n in does if n != number]
        if done is not True:
            arcs.append((number + 1, number + 1, done.negated()))
            model.add_implication(done, idle.negated())
        else:
            model.add(idle == 0)
        arcs.append((number + 1, 0, model.new_bool_var("")))
        for node, here, then in follows:
            arc = model.new_bool_var("")
            arcs.append((node, then + 1, arc))
            drive, _ = problem.drive(robot, here, then)
            lasts = int((drive + problem.jobs[then].work_s) * TENTHS)
            model.add(ends[then] >= starts[then] + lasts).only_enforce_if(arc)
            ready = ends[node - 1] if node else int(problem.free_s[robot] * TENTHS)
            model.add(starts[then] >= ready).only_enforce_if(arc)
    model.add_circuit(arcs)


if __name__ == "__main__":
    for row in measure():
        print(row)
