"""Finds in which order robots serve which jobs: greedy at first, then better by local search until the budget ends.

A list of all jobs is turned into times by giving each in turn to its robots at the earliest moment (a serial schedule
generation scheme, Kolisch 1996); some list gives the shortest schedule there is. The search moves one job or one robot
of a team at a time and accepts by late-acceptance hill climbing (Burke and Bykov 2017).
"""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from .problem import Answer, Problem

BUDGET_S: Final = 0.03
"""How long a search may keep everything else waiting."""
MEMORY: Final = 10
"""A change is accepted if it is no worse than what was accepted so many changes ago."""
PATIENCE: Final = 80
"""After so many changes without a gain the search goes back to the best answer and leaves it by `KICK` changes."""
KICK: Final = 5
TEAM_SHARE: Final = 0.35
"""Share of the changes that concern who does a job and not when."""
TIER_WEIGHT: Final = 0.05
"""What a second of the end of one tier counts against a second of the tier before."""
SUM_WEIGHT: Final = 0.01
"""What a second of the mean end of all jobs counts against one of the last end: of equal schedules the earlier one."""


@dataclass(frozen=True, slots=True)
class Limits:
    """When a search ends: whichever comes first."""

    seconds: float = BUDGET_S
    steps: int = 20_000
    clock: Callable[[], float] = time.perf_counter


def solve(problem: Problem, limits: Limits, seed: int = 0) -> Answer:
    """Return the best answer found; with no time at all that is the greedy one."""
    ends_at = limits.clock() + limits.seconds
    best = greedy(problem)
    if len(problem.jobs) < 2 or not problem.has_choice():
        return best
    search = _Search(problem, best, random.Random(seed))
    for step in range(limits.steps):
        if step % 8 == 0 and limits.clock() >= ends_at:
            break
        search.step()
    return search.best


def timed(problem: Problem, order: list[int], teams: list[tuple[int, ...]]) -> Answer:
    """Return the times of an order: each job as early as it can be after those before it in the list."""
    jobs, travel, tours = problem.jobs, problem.travel_s, problem.tours
    free, at = list(problem.free_s), list(problem.at)
    starts, ends = [0.0] * len(jobs), [0.0] * len(jobs)
    last: dict[int, float] = {}
    for number in order:
        job = jobs[number]
        team = job.robots if job.choice is None else (*job.robots, *teams[job.choice])
        start, drive = job.earliest_s, 0.0
        for other in job.after:
            start = max(start, ends[other])
        for robot in team:
            start = max(start, free[robot])
            tour = tours[robot][number]
            if tour is not None:
                seconds = travel[robot][at[robot]][tour[0]] + tour[1]
                at[robot] = tour[2]
                drive = max(drive, seconds)
        end = start + drive + job.work_s
        for robot in team:
            free[robot] = end
        starts[number], ends[number] = start, end
        if end > last.get(job.tier, 0.0):
            last[job.tier] = end
    cost = sum(end * TIER_WEIGHT**tier for tier, end in last.items()) + SUM_WEIGHT * sum(ends) / max(len(ends), 1)
    return Answer(order, teams, starts, ends, cost)


def greedy(problem: Problem) -> Answer:
    """Return the answer of list scheduling: the job that can begin first, of several the one with most to come."""
    tails = _tails(problem)
    free, at = list(problem.free_s), list(problem.at)
    teams: list[tuple[int, ...] | None] = [None] * len(problem.choices)
    ends = [0.0] * len(problem.jobs)
    order: list[int] = []
    open_jobs = set(range(len(problem.jobs)))
    while open_jobs:
        tier = min(problem.jobs[n].tier for n in open_jobs)
        offers: list[tuple[float, float, int, tuple[int, ...]]] = []
        for number in open_jobs:
            job = problem.jobs[number]
            if job.tier != tier or not open_jobs.isdisjoint(job.after):
                continue
            chosen = _nearest(problem, number, teams, free, at)
            start = max([job.earliest_s, *(ends[a] for a in job.after), *(free[r] for r in (*job.robots, *chosen))])
            offers.append((start, -tails[number], number, chosen))
        start, _, number, chosen = min(offers)
        job = problem.jobs[number]
        if job.choice is not None:
            teams[job.choice] = chosen
        team = (*job.robots, *chosen)
        drives = {r: problem.drive(r, at[r], number) for r in team}
        ends[number] = start + max((d for d, _ in drives.values()), default=0.0) + job.work_s
        for robot, (_, there) in drives.items():
            free[robot], at[robot] = ends[number], there
        order.append(number)
        open_jobs.remove(number)
    return timed(problem, order, [t or () for t in teams])


def _nearest(
    problem: Problem, number: int, teams: list[tuple[int, ...] | None], free: list[float], at: list[int]
) -> tuple[int, ...]:
    """Return the team of a job's selector: the one it has, else from each pool who would be done first."""
    job = problem.jobs[number]
    if job.choice is None:
        return ()
    known = teams[job.choice]
    if known is not None:
        return known
    chosen: list[int] = []
    for pool in problem.choices[job.choice].pools:
        left = [r for r in pool if r not in chosen and r not in job.robots]
        chosen.append(min(left, key=lambda r: free[r] + problem.drive(r, at[r], number)[0]))
    return tuple(chosen)


def _tails(problem: Problem) -> list[float]:
    """Return for each job how long it and the longest chain after it take at least, without driving."""
    tails = [job.work_s for job in problem.jobs]
    for number in reversed(range(len(problem.jobs))):
        for other in problem.jobs[number].after:
            tails[other] = max(tails[other], problem.jobs[other].work_s + tails[number])
    return tails


class _Search:
    """One walk through the orders and teams."""

    def __init__(self, problem: Problem, start: Answer, rng: random.Random) -> None:
        self._problem = problem
        self._rng = rng
        self._now = self.best = start
        self._memory = [start.cost] * MEMORY
        self._steps = self._gained_at = 0
        self._before = [set(j.after) for j in problem.jobs]
        self._open = [
            (c, place)
            for c, choice in enumerate(problem.choices)
            for place, pool in enumerate(choice.pools)
            if len(pool) > 1
        ]

    def step(self) -> None:
        """Try one change, or several at once after long without a gain."""
        if self._steps - self._gained_at > PATIENCE:
            self._gained_at = self._steps
            self._now = self.best
            for _ in range(KICK):
                self._now = self._changed() or self._now
            self._memory = [self._now.cost] * MEMORY
        self._steps += 1
        changed = self._changed()
        if changed is None:
            return
        slot = self._steps % MEMORY
        if changed.cost <= max(self._memory[slot], self._now.cost):
            self._now = changed
            if changed.cost < self.best.cost:
                self.best, self._gained_at = changed, self._steps
        self._memory[slot] = min(self._memory[slot], self._now.cost)

    def _changed(self) -> Answer | None:
        return self._other_team() if self._open and self._rng.random() < TEAM_SHARE else self._other_order()

    def _other_order(self) -> Answer | None:
        """Move one job to another place in its tier, after what it waits for and before what waits for it."""
        jobs, order = self._problem.jobs, self._now.order
        place = self._rng.randrange(len(order))
        number = order[place]
        tier = jobs[number].tier
        first = place
        while first > 0 and order[first - 1] not in self._before[number] and jobs[order[first - 1]].tier == tier:
            first -= 1
        last = place
        while (
            last + 1 < len(order)
            and number not in self._before[order[last + 1]]
            and jobs[order[last + 1]].tier == tier
        ):  # fmt: skip
            last += 1
        if first == last:
            return None
        to = self._rng.randrange(first, last)
        rest = [*order[:place], *order[place + 1 :]]
        moved = [*rest[: to + (to >= place)], number, *rest[to + (to >= place) :]]
        return timed(self._problem, moved, self._now.teams)

    def _other_team(self) -> Answer | None:
        """Take another robot for one place of one team."""
        number, place = self._rng.choice(self._open)
        team = self._now.teams[number]
        robot = self._rng.choice(self._problem.choices[number].pools[place])
        if robot in team:
            return None
        teams = list(self._now.teams)
        teams[number] = (*team[:place], robot, *team[place + 1 :])
        return timed(self._problem, self._now.order, teams)
