"""The question that the optimiser answers: open tasks, robots, places and times, as plain numbers.

Seconds are of the site, counted from now. Robots, places and jobs are numbers, so that a search can try thousands of
orders in a few tens of milliseconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

from muster_scheduler.core.queue import TaskKey

HOME = -1
"""Stands for the home of whichever robot does the job."""

SelectorKey = tuple[str, str]
"""(mission id, selector's name)."""


@dataclass(frozen=True, slots=True)
class Job:
    """A task that is ready or soon will be."""

    key: TaskKey
    after: tuple[int, ...] = ()
    """Jobs that must have ended; what else it waits for is in `earliest_s`."""
    robots: tuple[int, ...] = ()
    """Those that the plan names or its selector is bound to."""
    choice: int | None = None
    """Its open selector."""
    stops: tuple[int, ...] = ()
    """Places in turn; none: it is done where its robots are."""
    work_s: float = 0.0
    earliest_s: float = 0.0
    tier: int = 0
    """More urgent jobs (0 first) are never put off for less urgent ones."""


@dataclass(frozen=True, slots=True)
class Choice:
    """An open selector: one robot is to be taken from each pool, all of them different."""

    key: SelectorKey
    pools: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Problem:
    """All that the search knows."""

    robot_ids: tuple[str, ...]
    free_s: tuple[float, ...]
    """When each robot is done with what it does now."""
    at: tuple[int, ...]
    """Where each robot will then be."""
    homes: tuple[int, ...]
    travel_s: tuple[Sequence[Sequence[float]], ...]
    """For each robot: from place to place."""
    jobs: tuple[Job, ...]
    choices: tuple[Choice, ...] = ()

    @cached_property
    def tours(self) -> list[list[tuple[int, float, int] | None]]:
        """For each robot and job: its first stop, the seconds from there to its last one, and that; None: it stays."""
        return [[self._tour(robot, job.stops) for job in self.jobs] for robot in range(len(self.robot_ids))]

    def _tour(self, robot: int, stops: Sequence[int]) -> tuple[int, float, int] | None:
        places = [self.homes[robot] if s == HOME else s for s in stops]
        seconds = sum(self.travel_s[robot][a][b] for a, b in pairwise(places))
        return (places[0], seconds, places[-1]) if places else None

    def drive(self, robot: int, here: int, number: int) -> tuple[float, int]:
        """Return how long a robot drives for a job when it starts at a place, and where it then is."""
        tour = self.tours[robot][number]
        if tour is None:
            return 0.0, here
        return self.travel_s[robot][here][tour[0]] + tour[1], tour[2]

    def has_choice(self) -> bool:
        """Return whether there is anything to decide: whom to take, or whom a robot serves first."""
        if any(len(pool) > 1 for c in self.choices for pool in c.pools):
            return True
        before: list[int] = []
        for number, job in enumerate(self.jobs):
            earlier = 0
            for other in job.after:
                earlier |= before[other] | 1 << other
            before.append(earlier)
            team = {*job.robots, *(p[0] for p in (self.choices[job.choice].pools if job.choice is not None else ()))}
            for other in range(number):
                if not earlier >> other & 1 and team & {*self.jobs[other].robots, *self._only(self.jobs[other])}:
                    return True
        return False

    def _only(self, job: Job) -> Sequence[int]:
        return [p[0] for p in self.choices[job.choice].pools] if job.choice is not None else ()


@dataclass(slots=True)
class Answer:
    """An order of the jobs (every job after those that it waits for), teams for the choices, and what comes of them."""

    order: list[int]
    teams: list[tuple[int, ...]] = field(default_factory=list[tuple[int, ...]])
    starts_s: list[float] = field(default_factory=list[float])
    ends_s: list[float] = field(default_factory=list[float])
    cost: float = 0.0

    @property
    def makespan_s(self) -> float:
        """When the last job ends."""
        return max(self.ends_s, default=0.0)
