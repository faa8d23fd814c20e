"""Ask a planner every case of a data set and score what it says; needs no running site."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from muster_schemas.plan import Plan

from muster_planner.errors import SetupError
from muster_planner.offline import PlannedLine
from muster_planner.published import published_form
from muster_planner.surroundings import Surroundings

from .ablation import Reading, without_dependencies
from .cases import Case
from .fleet import Fleet
from .measures import Answer
from .scoring import Score, score


class Plans(Protocol):
    """What answers instructions, such as `offline.OfflinePlanner`."""

    def plan(self, text: str, *, id: str = "") -> PlannedLine:  # noqa: A002 (as in the files)
        """Return the plan, or why there is none."""
        ...


def chosen(cases: Sequence[Case], limit: int | None) -> list[Case]:
    """Return at most so many cases, drawn by chance (always the same ones), in their order."""
    if limit is None or limit >= len(cases):
        return list(cases)
    kept = set(random.Random(1).sample(range(len(cases)), limit))
    return [c for n, c in enumerate(cases) if n in kept]


@dataclass(frozen=True)
class Judge:
    """Scores answers to the cases of one site."""

    there: Surroundings
    dependencies: bool = True
    """False: the plan's own dependencies are dropped first, each robot does its tasks in the order of the list."""

    def answers(self, cases: Sequence[Case], planner: Plans, *, repeat: int = 1) -> Iterator[Answer]:
        """Ask every case in turn, all of them `repeat` times, and yield the scored answers as they come.

        Raises:
            SetupError: the model cannot be had; a failure of this kind would say nothing about plans.

        """
        for n in range(repeat):
            for case in cases:
                line = planner.plan(case.text, id=case.id)
                if isinstance(line.failure, SetupError):
                    raise line.failure
                yield self.judged(case, line, n)

    def judged(self, case: Case, line: PlannedLine, repeat: int = 0) -> Answer:
        """Return what an answer is worth."""
        refused = line.plan is None and line.failure is None
        if case.refuse is not None:
            return Answer(
                id=case.id,
                level=case.level,
                voice=case.voice,
                repeat=repeat,
                text=case.text,
                must_refuse=True,
                refused=refused,
                right=refused,
                why="" if refused else "must be refused",
                error=line.error,
                seconds=line.latency_s,
                plan=published_form(line.plan) if line.plan else None,
            )
        fleet = Fleet.of(self.there.roster)

        def of(plan: Plan | None, asked: Case = case) -> Score:
            return score(asked, plan, fleet, self.there.catalogue)

        queued = listed = None
        if line.plan:
            queued = without_dependencies(line.plan, fleet, Reading.QUEUES)
            listed = without_dependencies(line.plan, fleet, Reading.LIST)
        plan = line.plan if self.dependencies else queued
        result = of(plan)
        if line.plan is None:
            result = replace(result, why="refused" if refused else "no plan")
        return Answer.scored(
            case,
            result,
            repeat=repeat,
            refused=refused,
            error=line.error,
            seconds=line.latency_s,
            queues=of(queued).sr,
            listed=of(listed).sr,
            listed_in_order=of(listed, replace(case, unordered=())).sr,
            plan=published_form(plan) if plan and not result.right else None,
        )
