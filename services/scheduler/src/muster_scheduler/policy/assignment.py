"""What the optimiser last found, kept as advice: whom a selector should mean, and whom a robot serves first.

The advice lives beside the core and is never journaled; what is decided on it is. It is made anew when the outlook of a
mission has changed (it begins, a task of it failed, a robot came or went), not at every event: a robot that ends a task
finds the next one in the order that is known. Without advice, or with one that has become wrong, tasks start by urgency.
"""

import heapq
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

from muster_schemas.mission import TaskStatus

from muster_scheduler.core.queue import TaskKey
from muster_scheduler.core.state import Presence, State, Task

from .durations import Durations
from .outlook import NEVER, Question, ask
from .problem import Answer, SelectorKey
from .search import Limits, solve, timed
from .world import World

TOLERANCE_S: Final = 1.0
"""A task may go first where another was planned if it delays that one by no more than this."""

Rank = tuple[float, int, int, tuple[float, int, int]]


@dataclass(frozen=True, slots=True)
class Slot:
    """A task's place in the newest plan that holds it."""

    urgency: float
    plan: int
    place: int
    team: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Keep:
    """A robot had better wait for another task."""

    robot_id: str
    for_task: TaskKey
    until_s: float
    """Seconds from now."""


@dataclass(slots=True)
class Assignment:
    """The advice, and all that is needed to renew it."""

    limits: Limits = field(default_factory=Limits)
    durations: Durations = field(default_factory=Durations)
    searches: int = 0
    """How often there was something to optimise."""
    _slots: dict[TaskKey, Slot] = field(default_factory=dict[TaskKey, Slot])
    _teams: dict[SelectorKey, tuple[str, ...]] = field(default_factory=dict[SelectorKey, tuple[str, ...]])
    _plans: dict[str, list[TaskKey]] = field(default_factory=dict[str, list[TaskKey]])
    """Mission -> its tasks in the plan."""
    _queues: dict[str, list[TaskKey]] = field(default_factory=dict[str, list[TaskKey]])
    """Robot -> the tasks that it was planned for, in order."""
    _count: int = 0

    def review(self, state: State, world: World, missions: Collection[str], ready: Iterable[Task], at: float) -> None:
        """Plan anew around missions whose outlook has changed, and for ready tasks beyond the last plan's horizon."""
        wanted = dict.fromkeys(missions)
        wanted |= {t.mission_id: None for t in ready if t.key not in self._slots and not t.is_rule}
        if not wanted:
            return
        for mission_id in wanted:
            self._learn(state, mission_id)
        question = ask(state, world, self.durations, wanted, at)
        self._count += 1
        self.searches += question.problem.has_choice()
        answer = solve(question.problem, self.limits, seed=self._count)
        self._take(question, answer, {*wanted, *(t.mission_id for t in question.tasks)})

    def _take(self, question: Question, answer: Answer, missions: Collection[str]) -> None:
        for mission_id in missions:
            self._forget(mission_id)
        problem = question.problem
        for choice, team in zip(problem.choices, answer.teams, strict=True):
            self._teams[choice.key] = tuple(sorted(problem.robot_ids[r] for r in team))
        for place, number in enumerate(answer.order):
            task, job = question.tasks[number], problem.jobs[number]
            numbers = (*job.robots, *(answer.teams[job.choice] if job.choice is not None else ()))
            team = tuple(problem.robot_ids[r] for r in numbers)
            self._slots[task.key] = Slot(question.leaders[job.tier], self._count, place, team)
            self._plans.setdefault(task.mission_id, []).append(task.key)
            self.durations.expected[task.key] = answer.ends_s[number] - answer.starts_s[number]
            for robot_id in team:
                self._queues.setdefault(robot_id, []).append(task.key)

    def _forget(self, mission_id: str) -> None:
        for key in self._plans.pop(mission_id, ()):
            slot = self._slots.pop(key)
            for robot_id in slot.team:
                queue = [k for k in self._queues.get(robot_id, ()) if k != key]
                if queue:
                    self._queues[robot_id] = queue
                else:
                    self._queues.pop(robot_id, None)
        for key in [k for k in self._teams if k[0] == mission_id]:
            del self._teams[key]

    def _learn(self, state: State, mission_id: str) -> None:
        """Compare what was said of a mission's tasks with what they took."""
        mission = state.missions.get(mission_id)
        for key in self._plans.get(mission_id, ()):
            task = mission.tasks.get(key[1]) if mission else None
            if task is None or not task.state.ended:
                continue
            expected = self.durations.expected.pop(key, None)
            measured = task.started_at is not None and task.ended_at is not None and task.attempt == 1
            if expected and measured and task.state is TaskStatus.SUCCEEDED and not task.is_rule:
                robot_type = state.robots[task.robots[0]].card.type
                took = (task.ended_at or 0.0) - (task.started_at or 0.0)
                self.durations.learn(task.skill.verb, robot_type, expected, took)

    def rank(self, task: Task) -> Rank:
        """Return what ready tasks are sorted by: the plan's order among those of like urgency."""
        slot = self._slots.get(task.key)
        if slot is None:
            return task.order[0], 1 << 60, 0, task.order
        return slot.urgency, slot.plan, slot.place, task.order

    def next_for(self, robot_id: str, count: int) -> Iterator[TaskKey]:
        """Yield the first tasks that a robot was planned for."""
        yield from self._queues.get(robot_id, ())[:count]

    def team(self, task: Task) -> tuple[str, ...] | None:
        """Return which robots an open selector should mean, if that has been thought about."""
        return self._teams.get((task.mission_id, task.selector.name)) if task.selector else None

    def keep(self, state: State, world: World, task: Task, team: Collection[str], at: float) -> Keep | None:
        """Return why a task whose robots are free should not have them now: one is about to be wanted more elsewhere."""
        rank = self.rank(task)
        rivals = [
            (robot_id, key)
            for robot_id in team
            for key in self._queues.get(robot_id, ())
            if self._is_awaited(state, key, rank)
        ]
        if not rivals:
            return None
        question = ask(state, world, self.durations, {task.mission_id, *(k[0] for _, k in rivals)}, at)
        times = self._times(question)
        own = question.number(task.key)
        takes = times.ends_s[own] - times.starts_s[own] if own is not None else 60.0
        for robot_id, key in rivals:
            number = question.number(key)
            if number is None:
                continue
            starts = times.starts_s[number]
            if starts < NEVER and takes > starts + TOLERANCE_S:
                return Keep(robot_id, key, starts)
        return None

    def _is_awaited(self, state: State, key: TaskKey, rank: Rank) -> bool:
        """Return whether a planned task comes before a rank and has not begun."""
        task = state.task(key)
        return task is not None and task.state in (TaskStatus.WAITING, TaskStatus.READY) and self.rank(task) < rank

    def _times(self, question: Question) -> Answer:
        """Return when the planned tasks would start now, in the order that is known."""
        problem = question.problem
        after: list[list[int]] = [[] for _ in problem.jobs]
        missing = [len(job.after) for job in problem.jobs]
        for number, job in enumerate(problem.jobs):
            for other in job.after:
                after[other].append(number)
        heap = [(self.rank(question.tasks[n]), n) for n, count in enumerate(missing) if not count]
        heapq.heapify(heap)
        order: list[int] = []
        while heap:
            _, number = heapq.heappop(heap)
            order.append(number)
            for other in after[number]:
                missing[other] -= 1
                if not missing[other]:
                    heapq.heappush(heap, (self.rank(question.tasks[other]), other))
        numbers = {robot_id: n for n, robot_id in enumerate(problem.robot_ids)}
        teams: list[tuple[int, ...]] = []
        for choice in problem.choices:
            planned = [numbers[r] for r in self._teams.get(choice.key, ()) if r in numbers]
            teams.append(tuple(planned) if len(planned) == len(choice.pools) else _first(choice.pools))
        return timed(problem, order, teams)

    def outdated(self, state: State, task: Task) -> bool:
        """Return whether the team planned for an open selector can no longer be had."""
        team = self.team(task) or ()
        return any(r not in state.robots or state.robots[r].presence is not Presence.ONLINE for r in team)


def _first(pools: Iterable[tuple[int, ...]]) -> tuple[int, ...]:
    team: list[int] = []
    for pool in pools:
        team.append(next(r for r in pool if r not in team))
    return tuple(team)
