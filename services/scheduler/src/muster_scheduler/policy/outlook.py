"""From the core's state to the optimiser's question: the tasks that are ready or soon ready around some missions.

Never looks at all open tasks: it begins at missions whose outlook has changed and goes on to those that want the same
robots, until the horizon is full.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from muster_schemas.base import Point
from muster_schemas.mission import MissionStatus, TaskStatus
from muster_schemas.robot import RobotCard

from muster_scheduler.core.queue import TaskKey
from muster_scheduler.core.state import Mission, Robot, Selector, State, Task

from .binding import able, everyone, wanted_elsewhere
from .durations import Durations
from .problem import HOME, Choice, Job, Problem, SelectorKey
from .ways import Place, metres
from .world import World

HORIZON: Final = 48
"""So many tasks are thought about at once."""
NEIGHBOURS: Final = 4
"""So many tasks at the front of each robot's queue lead to other missions."""
POOL: Final = 12
"""So many robots come into question for one place in a team, the nearest of the free ones first."""
AT_M: Final = 6.0
"""A robot no farther than this from an object's edge is at it."""
STOPPING_S: Final = 10.0
"""A robot that has yet to say that it stopped is taken to need so long."""
LATE: Final = 3.0
"""A task that takes so many times longer than expected, and `LATE_BY_S`, may as well never end."""
LATE_BY_S: Final = 20.0
UNKNOWN_S: Final = 60.0
"""Expected of a task that nobody has estimated."""
NEVER: Final = 1e6

Planned = Mapping[str, Sequence[TaskKey]]
NOTHING: Final[Planned] = {}


@dataclass(slots=True)
class Question:
    """A problem, and which tasks its jobs are."""

    problem: Problem
    tasks: list[Task]
    leaders: list[float]
    """Urgency of the first mission of each tier."""

    def number(self, key: TaskKey) -> int | None:
        """Return a task's number among the jobs."""
        return next((n for n, t in enumerate(self.tasks) if t.key == key), None)


def ask(
    state: State, world: World, durations: Durations, missions: Iterable[str], at: float, planned: Planned = NOTHING
) -> Question:  # fmt: skip
    """Return the question about missions and those that want the same robots.

    Args:
        state: of the core.
        world: where things are.
        durations: what is known of them.
        missions: to begin with.
        at: the time now.
        planned: for each robot what it was planned for so far, also what is not ready yet.

    """
    return _Builder(state, world, durations, at).build(_around(state, missions, planned))


def remaining_s(state: State, durations: Durations, task: Task, at: float) -> float:
    """Return how much longer a task that is under way will take; `NEVER` if that is not to be expected."""
    mission = state.missions[task.mission_id]
    lost = not all(state.robots[r].in_service for r in task.runs)
    if lost or mission.state is not MissionStatus.RUNNING:
        return NEVER
    if task.closing is not None:
        return STOPPING_S
    expected = durations.expected.get(task.key, UNKNOWN_S)
    elapsed = at - (task.started_at or at)
    if elapsed > LATE * expected + LATE_BY_S:
        return NEVER
    # the longer a task is overdue, the longer it may still take
    return max(expected - elapsed, (elapsed - expected) / 2, 0.5)


def _is_running(mission: Mission) -> bool:
    return mission.state is MissionStatus.RUNNING and not mission.cancelling


def _around(state: State, missions: Iterable[str], planned: Planned) -> list[Mission]:
    """Return running missions and those that want the same robots, as far as the horizon goes; most urgent first."""
    found: dict[str, Mission] = {}
    todo = deque(m for m in missions if m in state.missions)
    size = 0
    while todo and size < HORIZON:
        mission = state.missions[todo.popleft()]
        if mission.mission_id not in found and _is_running(mission):
            found[mission.mission_id] = mission
            size += mission.open_tasks
            todo += _rivals(state, mission, planned)
    return sorted(found.values(), key=lambda m: (m.urgency, m.number))


def _rivals(state: State, mission: Mission, planned: Planned) -> dict[str, None]:
    """Return the missions at the front of the queues for a mission's robots, and those that have them now."""
    robots = {*mission.named, *(r for team in mission.bound.values() for r in team)}
    open_types = {t for s in mission.selectors if s.name not in mission.bound for t in (s.types or ("",))}
    if open_types:
        robots |= {r for r, robot in state.robots.items() if robot.card.type in open_types}
    holders = (state.robots[r].holder for r in sorted(robots) if r in state.robots)
    rivals = {holder[0]: None for holder in holders if holder is not None}
    for index, names in ((state.wanting_robot, robots), (state.wanting_type, open_types)):
        for name in sorted(names):
            queue = index.get(name)
            rivals |= dict.fromkeys(m for m, _ in (queue.first(NEIGHBOURS) if queue else ()))
    for name in sorted(robots):
        rivals |= dict.fromkeys(m for m, _ in planned.get(name, ()))
    return rivals


@dataclass(slots=True)
class _Builder:
    state: State
    world: World
    durations: Durations
    at: float
    jobs: list[Job] = field(default_factory=list[Job])
    tasks: list[Task] = field(default_factory=list[Task])
    choices: list[Choice] = field(default_factory=list[Choice])
    robots: dict[str, int] = field(default_factory=dict[str, int])
    free_s: list[float] = field(default_factory=list[float])
    here: list[int] = field(default_factory=list[int])
    homes: list[int] = field(default_factory=list[int])
    places: list[Place] = field(default_factory=list[Place])
    place_of: dict[str, int] = field(default_factory=dict[str, int])
    numbers: dict[TaskKey, int] = field(default_factory=dict[TaskKey, int])
    choice_of: dict[SelectorKey, int | None] = field(default_factory=dict[SelectorKey, "int | None"])

    def build(self, missions: Sequence[Mission]) -> Question:
        leaders: list[float] = []
        for mission in missions:
            if not leaders or mission.urgency - leaders[-1] >= self.state.policy.ageing_s / 2:
                leaders.append(mission.urgency)
            for task in _in_order(mission):
                if len(self.jobs) >= HORIZON:
                    break
                job = self._job(mission, task, len(leaders) - 1)
                if job is not None:
                    self.numbers[task.key] = len(self.jobs)
                    self.jobs.append(job)
                    self.tasks.append(task)
        kinds: dict[tuple[str, float], list[list[float]]] = {}
        problem = Problem(
            robot_ids=tuple(self.robots),
            free_s=tuple(self.free_s),
            at=tuple(self.here),
            homes=tuple(self.homes),
            travel_s=tuple(self._travel(self.state.robots[r].card, kinds) for r in self.robots),
            jobs=tuple(self.jobs),
            choices=tuple(self.choices),
        )
        return Question(problem, self.tasks, leaders)

    def _job(self, mission: Mission, task: Task, tier: int) -> Job | None:
        """Return a task as a job, or None if nobody can say when it will start."""
        earliest = max((task.hold_until or 0.0) - self.at, 0.0)
        after: list[int] = []
        for other in task.unmet:
            if other in mission.active:
                earliest = max(earliest, remaining_s(self.state, self.durations, mission.tasks[other], self.at))
            elif (mission.mission_id, other) in self.numbers:
                after.append(self.numbers[mission.mission_id, other])
            else:
                return None
        team = self._team(mission, task)
        if team is None or task.missing or earliest >= NEVER:
            return None
        named, choice = team
        ids = list(self.robots)
        members = {*named, *(r for p in (self.choices[choice].pools if choice is not None else ()) for r in p)}
        types = {self.state.robots[ids[r]].card.type for r in members} or {""}
        return Job(
            key=task.key,
            after=tuple(after),
            robots=named,
            choice=choice,
            stops=self._stops(task),
            work_s=max(self.durations.work_s(task.skill, t) for t in sorted(types)),
            earliest_s=earliest,
            tier=tier,
        )

    def _stops(self, task: Task) -> tuple[int, ...]:
        if task.is_rule:
            return ()
        if task.skill.verb == "home":
            return (HOME,)
        return tuple(self._at(name) for name in task.objects if name in self.world.objects)

    def _team(self, mission: Mission, task: Task) -> tuple[tuple[int, ...], int | None] | None:
        """Return who does a task: the robots that are fixed, and the open selector; None if that cannot be for now."""
        selector = task.selector
        if task.is_rule:
            return (), None
        if not task.robots and selector is not None and selector.count is not None:
            key = mission.mission_id, selector.name
            if key not in self.choice_of:
                self.choice_of[key] = self._choice(mission, selector, task.named)
            choice = self.choice_of[key]
            named = [self._robot(r) for r in task.named]
            if choice is None or None in named:
                return None
            return tuple(r for r in named if r is not None), choice
        names = task.robots or (everyone(self.state, mission, selector) if selector is not None else ())
        team = [self._robot(r) for r in names]
        return (tuple(r for r in team if r is not None), None) if team and None not in team else None

    def _choice(self, mission: Mission, selector: Selector, named: Sequence[str]) -> int | None:
        """Return the number of an open selector, or None if there are too few robots for it."""
        pools: list[tuple[int, ...]] = []
        elsewhere = wanted_elsewhere(mission, selector)
        for kind in selector.types:
            fit = [
                r
                for r in self.state.robots.values()
                if r.card.type == kind and r.card.robot_id not in named and able(mission, selector, r.card)
            ]
            if len([r for r in fit if r.card.robot_id not in elsewhere]) >= (selector.count or 0):
                fit = [r for r in fit if r.card.robot_id not in elsewhere]
            fit.sort(key=lambda r: (not r.free, r.card.robot_id))
            numbers = [
                n
                for r in fit[: max(POOL, 2 * (selector.count or 0))]
                if (n := self._robot(r.card.robot_id)) is not None
            ]
            if len(numbers) < (selector.count or 0):
                return None
            pools += [tuple(numbers)] * (selector.count or 0)
        self.choices.append(Choice((mission.mission_id, selector.name), tuple(pools)))
        return len(self.choices) - 1

    def _robot(self, robot_id: str) -> int | None:
        """Return a robot's number, or None if it cannot be counted on."""
        if robot_id in self.robots:
            return self.robots[robot_id]
        robot = self.state.robots.get(robot_id)
        if robot is None or not robot.in_service:
            return None
        task = self.state.task(robot.holder) if robot.holder else None
        busy = remaining_s(self.state, self.durations, task, self.at) if task is not None else 0.0
        if busy >= NEVER:
            return None
        self.robots[robot_id] = len(self.robots)
        self.free_s.append(max(busy, STOPPING_S if robot.loose_ends else 0.0))
        self.here.append(self._whereabouts(robot, task))
        self.homes.append(self._place(robot.card.home))
        return self.robots[robot_id]

    def _whereabouts(self, robot: Robot, task: Task | None) -> int:
        """Return where a robot will be when it is free: at the object of what it does, else where it stands."""
        run = task.runs.get(robot.card.robot_id) if task else None
        pose = run.order.goals[-1] if run is not None and run.order.goals else self.world.pose(robot.card)
        near = [(pose.distance(o.position) - o.radius_m, name) for name, o in self.world.objects.items()]
        gap, name = min(near, default=(AT_M, ""))
        return self._at(name) if gap < AT_M else self._place(pose)

    def _at(self, name: str) -> int:
        """Return the number of an object as a place."""
        if name not in self.place_of:
            thing = self.world.objects[name]
            self.place_of[name] = self._place(thing.position, thing.radius_m)
        return self.place_of[name]

    def _place(self, position: Point, radius_m: float = 0.0) -> int:
        self.places.append(Place(position.x, position.y, radius_m))
        return len(self.places) - 1

    def _travel(self, card: RobotCard, kinds: dict[tuple[str, float], list[list[float]]]) -> list[list[float]]:
        """Return the seconds from place to place for a kind of robot."""
        kind = card.type, card.max_speed_mps
        if kind not in kinds:
            ways = [metres(self.places, goal) for goal in self.places]
            kinds[kind] = [[self.durations.drive_s(to[n], card) for to in ways] for n in range(len(self.places))]
        return kinds[kind]


def _in_order(mission: Mission) -> Iterator[Task]:
    """Yield the tasks that have not begun, each after those that it waits for."""
    open_tasks = [t for t in mission.tasks.values() if t.state in (TaskStatus.READY, TaskStatus.WAITING)]
    missing: dict[str, int] = {t.task_id: len(t.unmet - mission.active) for t in open_tasks}
    queue = deque(t for t in open_tasks if not missing[t.task_id])
    while queue:
        task = queue.popleft()
        yield task
        for after_id in mission.graph.successors(task.task_id):
            if after_id in missing:
                missing[after_id] -= 1
                if not missing[after_id]:
                    queue.append(mission.tasks[after_id])
