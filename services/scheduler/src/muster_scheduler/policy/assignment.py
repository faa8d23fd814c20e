"""What the optimiser last found, kept as advice: whom a selector should mean, and whom a robot serves first.

The advice lives beside the core and is never journaled; what is decided on it is. It is made anew when the outlook of a
mission has changed (it begins, a task of it failed, a robot came or went), not at every event: a robot that ends a task
finds the next one in the order that is known. Without advice tasks start by urgency.
"""

import heapq
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

from muster_schemas.mission import TaskStatus

from muster_scheduler.core.queue import TaskKey
from muster_scheduler.core.state import State, Task

from .durations import Durations
from .outlook import NEIGHBOURS, NEVER, Question, ask, remaining_s
from .problem import Answer, Problem, SelectorKey
from .search import Limits, solve, timed
from .world import World

TOLERANCE_S: Final = 1.0
"""A task may go first where another was planned if it delays that one by no more than this."""

LAST: Final = 1 << 60

Rank = tuple[float, int, int, tuple[float, int, int]]


@dataclass(frozen=True, slots=True)
class Slot:
    """A task's place in the newest plan that holds it."""

    urgency: float
    """Of the first mission of its tier."""
    plan: int
    place: int
    team: tuple[str, ...]
    made_at: float


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
    """Robot -> the tasks that it was planned for, by rank."""
    _count: int = 0

    def review(self, state: State, world: World, missions: Collection[str], first: Task | None, at: float) -> bool:
        """Plan anew if the outlook has changed for missions, or if a task could start that nobody has thought about.

        Args:
            state: of the core.
            world: where things are.
            missions: whose outlook has changed.
            first: the task that would start first.
            at: the time now.

        Returns:
            whether anything may have changed.

        """
        wanted = {m: None for m in missions if m in self._plans or self._is_near(state, m)}
        if first is not None and first.key not in self._slots and not first.is_rule:
            wanted[first.mission_id] = None
        if not wanted:
            return False
        self._tidy(state)
        question = ask(state, world, self.durations, wanted, at, self._queues)
        self._count += 1
        self.searches += question.problem.has_choice()
        self._take(question, solve(question.problem, self.limits, seed=self._count), wanted, at)
        if first is not None and first.key not in self._slots:
            # beyond the horizon: it goes by urgency, and is not thought about again until something changes
            self._put(first, Slot(first.order[0], self._count, LAST, (), at))
        return True

    @staticmethod
    def _is_near(state: State, mission_id: str) -> bool:
        """Return whether a mission's tasks are at the front of queues, so that it matters soon; a backlog can wait."""
        mission = state.missions.get(mission_id)
        if mission is None:
            return False
        types = {t for s in mission.selectors for t in (s.types or ("",))}
        for index, names in ((state.wanting_robot, mission.named), (state.wanting_type, types)):
            for name in names:
                queue = index.get(name)
                if queue and any(key[0] == mission_id for key in queue.first(NEIGHBOURS)):
                    return True
        return False

    def _put(self, task: Task, slot: Slot) -> None:
        self._slots[task.key] = slot
        self._plans.setdefault(task.mission_id, []).append(task.key)
        for robot_id in slot.team:
            self._queues.setdefault(robot_id, []).append(task.key)

    def _take(self, question: Question, answer: Answer, missions: Iterable[str], at: float) -> None:
        for mission_id in {*missions, *(t.mission_id for t in question.tasks)}:
            self._forget(mission_id)
        problem = question.problem
        for choice, team in zip(problem.choices, answer.teams, strict=True):
            self._teams[choice.key] = tuple(sorted(problem.robot_ids[r] for r in team))
        for place, number in enumerate(answer.order):
            task, job = question.tasks[number], problem.jobs[number]
            numbers = (*job.robots, *(answer.teams[job.choice] if job.choice is not None else ()))
            team = tuple(problem.robot_ids[r] for r in numbers)
            self._put(task, Slot(question.leaders[job.tier], self._count, place, team, at))
            self.durations.expected[task.key] = answer.ends_s[number] - answer.starts_s[number]
        for robot_id in problem.robot_ids:
            # what other plans have for it stays between
            self._queues.get(robot_id, []).sort(key=self._place)

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

    def _tidy(self, state: State) -> None:
        """Learn from the planned tasks that have ended, and forget missions that have."""
        for mission_id in list(self._plans):
            mission = state.missions.get(mission_id)
            for key in self._plans[mission_id]:
                task = mission.tasks.get(key[1]) if mission else None
                if task is None or task.state.ended:
                    expected = self.durations.expected.pop(key, None)
                    if task is not None and expected is not None:
                        self._learn(state, task, expected)
            if mission is None or mission.state.ended:
                self._forget(mission_id)

    def _learn(self, state: State, task: Task, expected_s: float) -> None:
        """Compare what was said of a task with what it took."""
        began, ended = task.started_at, task.ended_at
        if (
            task.state is not TaskStatus.SUCCEEDED
            or task.attempt != 1
            or task.is_rule
            or began is None
            or ended is None
        ):
            return
        self.durations.learn(task.skill.verb, state.robots[task.robots[0]].card.type, expected_s, ended - began)

    def _place(self, key: TaskKey) -> tuple[float, int, int]:
        slot = self._slots[key]
        return slot.urgency, slot.plan, slot.place

    def rank(self, task: Task) -> Rank:
        """Return what ready tasks are sorted by: the plan's order among those of like urgency."""
        slot = self._slots.get(task.key)
        if slot is None:
            return task.order[0], LAST, 0, task.order
        return slot.urgency, slot.plan, slot.place, task.order

    def next_for(self, state: State, robot_id: str, count: int) -> Iterator[TaskKey]:
        """Yield the first tasks that a robot was planned for and that have not begun."""
        queue = self._queues.get(robot_id, [])
        while queue and not _is_to_come(state.task(queue[0])):
            queue.pop(0)
        yield from queue[:count]

    def team(self, state: State, task: Task, at: float) -> tuple[str, ...] | None:
        """Return which robots a task with an open selector should have, if that has been thought about.

        None as well if one of them has gone or is at something that does not come to its end.
        """
        selector, slot = task.selector, self._slots.get(task.key)
        robots = self._teams.get((task.mission_id, selector.name)) if selector is not None else None
        if robots is None or slot is None:
            return None
        team = (*task.named, *robots)
        return team if all(self._is_expected(state, r, at) for r in team) else None

    def _is_expected(self, state: State, robot_id: str, at: float) -> bool:
        robot = state.robots.get(robot_id)
        if robot is None or not robot.in_service:
            return False
        task = state.task(robot.holder) if robot.holder is not None else None
        return task is None or remaining_s(state, self.durations, task, at) < NEVER

    def keep(self, state: State, world: World, task: Task, team: Collection[str], at: float) -> Keep | None:
        """Return why a task whose robots are free should not have them now: one is wanted more elsewhere, and soon."""
        rank = self.rank(task)
        rivals = [(robot_id, key) for robot_id in team for key in self._before(state, robot_id, rank)]
        if not rivals:
            return None
        question = ask(state, world, self.durations, {task.mission_id, *(k[0] for _, k in rivals)}, at, self._queues)
        own = question.number(task.key)
        order, teams = self._order(question), self._known_teams(question.problem)
        planned = timed(question.problem, order, teams)
        first = None if own is None else timed(question.problem, [own, *(n for n in order if n != own)], teams)
        for robot_id, key in rivals:
            number = question.number(key)
            # a rival that nobody can say the time of is not waited for
            if number is None or planned.starts_s[number] >= NEVER:
                continue
            if first is None or first.ends_s[number] > planned.ends_s[number] + TOLERANCE_S:
                return Keep(robot_id, key, planned.starts_s[number])
        return None

    def _before(self, state: State, robot_id: str, rank: Rank) -> Iterator[TaskKey]:
        """Yield what a robot was planned for before a rank and has not begun."""
        for key in self._queues.get(robot_id, ()):
            task = state.task(key)
            if task is not None and self.rank(task) >= rank:
                return
            if _is_to_come(task):
                yield key

    def _order(self, question: Question) -> list[int]:
        """Return the jobs in the order that is known, each after those that it waits for."""
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
        return order

    def _known_teams(self, problem: Problem) -> list[tuple[int, ...]]:
        numbers = {robot_id: n for n, robot_id in enumerate(problem.robot_ids)}
        teams: list[tuple[int, ...]] = []
        for choice in problem.choices:
            planned = [numbers[r] for r in self._teams.get(choice.key, ()) if r in numbers]
            teams.append(tuple(planned) if len(planned) == len(choice.pools) else _first(choice.pools))
        return teams


def _is_to_come(task: Task | None) -> bool:
    return task is not None and task.state in (TaskStatus.WAITING, TaskStatus.READY)


def _first(pools: Iterable[tuple[int, ...]]) -> tuple[int, ...]:
    team: list[int] = []
    for pool in pools:
        team.append(next(r for r in pool if r not in team))
    return tuple(team)
