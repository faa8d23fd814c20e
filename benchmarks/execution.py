"""Execution as the last judge: missions of a data set, planned by the model, run in the simulator to their end.

    python -m benchmarks.execution [DATASET.jsonl] [--limit N] [--planner X] [--out NAME]

A mission counts when the site is in the state that the case's right plan leads to (`goals`): robots, loads, piles,
heaps, things and rules, and everything else untouched. SR of the same plans stands beside it. Several missions share a
site, tidied in between; one whose objects an earlier one has moved gets a site of its own.
"""

import argparse
import asyncio
import tempfile
import time
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Self

from muster_bus import Bus, NoReplyError, open_bus
from muster_bus.testing import SITE_FILE, free_port
from muster_cli import launch, site
from muster_cli.processes import Options
from muster_cli.record import DataDirectory
from muster_planner.evaluation.cases import Case, read_cases
from muster_planner.evaluation.fleet import Fleet
from muster_planner.evaluation.running import Judge, chosen
from muster_planner.offline import open_offline
from muster_planner.surroundings import Surroundings
from muster_schemas.channels import MISSIONS, RULES, SIM_WORLD, SUBMIT
from muster_schemas.mission import MissionStatus, MissionView
from muster_schemas.plan import Plan
from muster_schemas.rpc import ControlReply, MissionsQuery, MissionsReply, RulesQuery, SubmitMission
from muster_schemas.sim import SimWorld
from muster_schemas.site import Site, load_site
from muster_schemas.world import AreaRules
from pydantic import BaseModel
from rich.console import Console

from .goals import goal_of, unmet

DATASET: Final = Path(__file__).parents[1] / "services" / "planner" / "training" / "development.jsonl"
LIMIT: Final = 8
SPEED: Final = 8.0
ENDS_WITHIN_S: Final = 600.0
"""Of the clock; a mission that has not ended by then has not reached its goal."""
NOT_ENDED: Final = "not ended"
SETTLES_S: Final = 2.0
"""Site time after a mission's end until soil and machines are at rest."""

_err = Console(stderr=True)


class Ran(BaseModel):
    """What became of one case."""

    id: str
    level: str
    text: str
    right: bool
    """By the scorer."""
    ended: str
    """How the mission ended; `no plan` if it never began."""
    reached: bool
    unmet: tuple[str, ...]
    """What is not as it should be."""


class Execution(BaseModel):
    """All of them."""

    dataset: str
    planner: str
    ran: tuple[Ran, ...]

    def share(self, of: str, level: str | None = None) -> float:
        """Return how many of the cases (of a level) have this field true, from 0 to 1."""
        cases = [r for r in self.ran if level in (None, r.level)]
        return sum(bool(getattr(r, of)) for r in cases) / len(cases)

    def markdown(self) -> str:
        """Return the table, and what was not reached."""
        levels = sorted({r.level for r in self.ran})
        lines = [
            "<!-- written by `python -m benchmarks.execution --out`; do not edit -->",
            f"# {self.dataset}, planner {self.planner}, run in the simulator",
            "",
            "| level | missions | SR | goal reached | plan right and goal missed | plan wrong and goal reached |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        for level in (*levels, None):
            cases = [r for r in self.ran if level in (None, r.level)]
            missed = sum(r.right and not r.reached for r in cases)
            lucky = sum(r.reached and not r.right for r in cases)
            shares = f"{self.share('right', level):.3f} | {self.share('reached', level):.3f}"
            lines.append(f"| {level or 'all'} | {len(cases)} | {shares} | {missed} | {lucky} |")
        lines += ["", *(f"- {r.id} ({r.ended}): {'; '.join(r.unmet)}" for r in self.ran if not r.reached)]
        return "\n".join(lines) + "\n"


def measure() -> list[dict[str, Any]]:
    """Return the share of missions that reach their goal, and SR of the same plans."""
    result = execute(DATASET, limit=LIMIT)
    return [
        {"name": name, "value": result.share(field), "unit": f"of {len(result.ran)} missions", "bar": None, "ok": True}
        for name, field in (("execution_goal_reached", "reached"), ("execution_sr", "right"))
    ]


def execute(dataset: Path, *, limit: int | None, planner: str = "embedded") -> Execution:
    """Plan the cases of a data set that have a plan, run what was planned, and judge the end of each."""
    the_site = load_site(SITE_FILE)
    there = Surroundings.of_file(the_site)
    cases = chosen([c for c in read_cases(dataset, there) if c.refuse is None], limit)
    judge = Judge(there)
    ran: dict[str, Ran] = {}
    planned: list[tuple[Case, Plan, bool]] = []
    with open_offline(the_site, planner) as offline:
        for case in cases:
            line = offline.plan(case.text, id=case.id)
            right = judge.judged(case, line).right
            if line.plan:
                planned.append((case, line.plan, right))
            else:
                ran[case.id] = _ran(case, right=right, ended="no plan", wrong=[line.error or "no plan"])
    while planned:
        with _Site.up() as running:
            for case, plan, right in _of_one_site(planned):
                planned.remove((case, plan, right))
                done = asyncio.run(running.run(case, plan, right=right))
                ran[case.id] = done
                _err.print(
                    f"{len(ran)} of {len(cases)}: {case.id} {done.ended}, "
                    + ("goal reached" if done.reached else "; ".join(done.unmet)),
                    highlight=False,
                )
                if done.ended == NOT_ENDED or not asyncio.run(running.tidy()):
                    break
    return Execution(dataset=dataset.name, planner=planner, ran=tuple(ran[c.id] for c in cases))


def _of_one_site(planned: Sequence[tuple[Case, Plan, bool]]) -> Iterator[tuple[Case, Plan, bool]]:
    """Yield missions that can share a site: what one moves, no later one names. Those that move nothing come first."""
    gone: set[str] = set()
    for entry in sorted(planned, key=lambda p: len(_moved(p[0], p[1]))):
        if not gone & _named(entry[0], entry[1]):
            gone |= _moved(entry[0], entry[1])
            yield entry


def _named(case: Case, plan: Plan) -> set[str]:
    planned = {o for t in plan.tasks for o in t.instruction_function.object_keywords}
    return planned | {o for w in case.wanted for objects in w.objects for o in objects}


def _moved(case: Case, plan: Plan) -> set[str]:
    """Return the things that the mission may pick up: solid ones that are named where something is dug."""
    digs = any(t.instruction_function.skill == "excavator_digging" for t in plan.tasks)
    return {o for o in _named(case, plan) if digs and o.startswith(("obstacle", "rock"))}


def _ran(case: Case, *, right: bool, ended: str, wrong: Iterable[str]) -> Ran:
    unmet_ = tuple(wrong)
    return Ran(id=case.id, level=case.level, text=case.text, right=right, ended=ended, reached=not unmet_, unmet=unmet_)


class _Site:
    """A whole site in processes of its own, below a folder that goes with it."""

    def __init__(self, the_site: Site, endpoint: str) -> None:
        self._site = the_site
        self._endpoint = endpoint
        self._fleet = Fleet.of(Surroundings.of_file(the_site).roster)

    @classmethod
    @contextmanager
    def up(cls) -> Generator[Self]:
        with tempfile.TemporaryDirectory() as folder:
            options = Options(
                site_file=SITE_FILE,
                data_dir=Path(folder) / "data",
                bus_port=free_port(),
                port=free_port(),
                speed_factor=SPEED,
                driver="sim",
                planner="embedded",
                log_level="warning",
            )
            record = site.up(options, _err)
            try:
                yield cls(load_site(SITE_FILE), record.plan.endpoint)
            finally:
                launch.stop(DataDirectory(options.data_dir))

    async def run(self, case: Case, plan: Plan, *, right: bool) -> Ran:
        """Run a planned mission to its end and compare the site with the case's goal."""
        async with open_bus(self._site.name, [self._endpoint]) as bus:
            before = await _truth(bus)
            view = await _until_ended(bus, case.text, plan)
            ended = view.mission.state.value if view.mission.state.ended else NOT_ENDED
            after = await _truth(bus, settled=True)
            rules: AreaRules = await bus.ask(RULES, RulesQuery(), timeout_s=30)
        wrong = unmet(goal_of(case, self._site), self._site, self._fleet, before, after, rules)
        if not view.mission.state.ended:
            wrong.append(f"not ended after {ENDS_WITHIN_S:.0f} s")
        wrong += [f"{t.name} failed: {t.error}" for t in view.tasks if t.error and wrong]
        return _ran(case, right=right, ended=ended, wrong=wrong)

    async def tidy(self) -> bool:
        """Lift all rules, empty buckets and beds onto the first pile, send everyone home; tell whether that worked."""
        async with open_bus(self._site.name, [self._endpoint]) as bus:
            world = await _truth(bus)
            rules: AreaRules = await bus.ask(RULES, RulesQuery(), timeout_s=30)
            pile = next(t.name for t in self._site.things if t.object_class == "soil")
            view = await _until_ended(bus, "Tidy up.", _tidying(world, rules, pile, self._site))
            return view.mission.state is MissionStatus.SUCCEEDED


def _tidying(world: SimWorld, rules: AreaRules, pile: str, the_site: Site) -> Plan:
    types = {r.id: r.type for r in the_site.robots}
    tasks: list[dict[str, Any]] = []

    def add(name: str, **function: Any) -> None:
        before = [tasks[-1]["task"]] if tasks else []
        task = f"tidy_{len(tasks) + 1}"
        tasks.append({"task": task, "instruction_function": {"name": name, "dependencies": before, **function}})

    if rules.rules:
        add("allow_areas_for_all_robots", object_keywords=sorted({r.object_name for r in rules.rules}))
    for robot_id, body in world.robots.items():
        if not body.load.empty:
            skill = "ExcavatorUnloading" if types[robot_id] == "excavator" else "DumpUnloading"
            add("target_area_for_specific_robots", robot_ids=[robot_id], object_keywords=[pile])
            add(skill, robot_ids=[robot_id])
            add("return_to_start_for_specific_robots", robot_ids=[robot_id])
    add("return_to_start_for_all_robots")
    return Plan.model_validate({"tasks": tasks})


async def _truth(bus: Bus, *, settled: bool = False) -> SimWorld:
    """Return the simulator's truth; `settled`: some site time from now."""
    async with bus.subscribe(SIM_WORLD) as messages:
        until_s: float | None = None
        async for received in messages:
            world = received.message
            if world is None:
                continue
            if until_s is None:
                until_s = world.site_time_s + (SETTLES_S if settled else 0.0)
            if world.site_time_s >= until_s:
                return world
    raise RuntimeError("the simulator says nothing")


async def _until_ended(bus: Bus, text: str, plan: Plan) -> MissionView:
    """Hand a mission to the scheduler and return it once it has ended, or at the time limit."""
    reply: ControlReply = await bus.ask(SUBMIT, SubmitMission(text=text, plan=plan), timeout_s=30)
    until = time.monotonic() + ENDS_WITHIN_S
    while True:
        try:
            found: MissionsReply = await bus.ask(MISSIONS, MissionsQuery(mission_id=reply.mission_id), timeout_s=10)
            view = found.missions[0]
            if view.mission.state.ended or time.monotonic() > until:
                return view
        except NoReplyError:
            if time.monotonic() > until:
                raise
        await asyncio.sleep(0.25)


def main() -> None:
    """Execute, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", nargs="?", type=Path, default=DATASET)
    parser.add_argument("--limit", type=int, help="so many cases at most, drawn by chance (seeded)")
    parser.add_argument("--planner", default="embedded")
    parser.add_argument("--out", type=Path, metavar="NAME", help="write NAME.json and NAME.md")
    given = parser.parse_args()
    result = execute(given.dataset, limit=given.limit, planner=given.planner)
    print(result.markdown())
    if given.out:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        given.out.with_suffix(".json").write_text(result.model_dump_json(indent=1) + "\n", encoding="utf-8")
        given.out.with_suffix(".md").write_text(result.markdown(), encoding="utf-8")


if __name__ == "__main__":
    main()
