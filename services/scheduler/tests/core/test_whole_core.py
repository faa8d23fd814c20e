"""Random plans, robots, duplicates, delays, losses and cancels against the core; invariants after every event."""

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from muster_scheduler.core.archive import archivable
from muster_scheduler.core.core import Core
from muster_scheduler.core.errors import NotPossibleError
from muster_scheduler.core.events import EVENT, MissionsArchived, Policy, Started
from muster_scheduler.core.invariants import validate
from muster_scheduler.core.memory import dump, load
from muster_scheduler.core.missions import DECISIONS, is_possible
from muster_scheduler.core.state import Awaits, Mission, Task
from muster_scheduler.testing import Yard, planned, replayed, yard_file
from muster_schemas.plan import Plan, PlanTask
from muster_schemas.policies import FailurePolicies, FailurePolicy, Measure
from muster_schemas.robot import RequestAction, SkillStatus, SkillStatusKind, TaskRef
from muster_schemas.rpc import MissionAction
from muster_schemas.site import load_site

SITE = load_site(yard_file())
EXCAVATORS = [r.id for r in SITE.robots if r.type == "excavator"]
TRUCKS = [r.id for r in SITE.robots if r.type == "dump_truck"]
THINGS = [t.name for t in SITE.things]
WORK = {
    "Excavation": EXCAVATORS,
    "ExcavatorUnloading": EXCAVATORS,
    "DumpLoading": TRUCKS,
    "DumpUnloading": TRUCKS,
    "target_area_for_specific_robots": EXCAVATORS + TRUCKS,
    "return_to_start_for_specific_robots": EXCAVATORS + TRUCKS,
    "avoid_areas_for_specific_robots": EXCAVATORS + TRUCKS,
    "allow_areas_for_specific_robots": EXCAVATORS + TRUCKS,
}
FINAL = [k for k in SkillStatusKind if k.final]
indexes = st.integers(0, 10_000)


@st.composite
def plans(draw: st.DrawFn) -> tuple[PlanTask, ...]:
    """Draw a plan that the gate lets pass: any skills, named robots and selectors, an acyclic graph."""
    tasks: list[PlanTask] = []
    for i in range(draw(st.integers(1, 6))):
        skill = draw(st.sampled_from(sorted(WORK)))
        robots = WORK[skill]
        after = [t.task for t in tasks if draw(st.integers(0, 2)) == 0]
        drives = "area" in skill
        objects = draw(st.lists(st.sampled_from(THINGS), min_size=1, max_size=2, unique=True)) if drives else []
        if draw(st.booleans()):
            named = draw(st.lists(st.sampled_from(robots), min_size=1, max_size=3, unique=True))
            tasks.append(planned(f"n{i}", skill, named, after, objects=objects))
        else:
            kind = "excavator" if robots[0] in EXCAVATORS and draw(st.booleans()) else "dump_truck"
            kind = kind if len(robots) > 3 else SITE.card(robots[0], "b").type
            count = draw(st.sampled_from([1, 2, 3, "all"]))
            tasks.append(planned(f"n{i}", skill, (), after, objects=objects, types=[kind], count=count))
    return tuple(tasks)


class WholeCore(RuleBasedStateMachine):
    """The site goes on around the core in any order; `attempts` is what the robots know for themselves."""

    def __init__(self) -> None:
        super().__init__()
        self.policy = Policy()
        self.yard = Yard(SITE)
        self.missions: list[Mission] = []
        self.begun: dict[tuple[str, TaskRef], SkillStatusKind] = {}
        """Robot and attempt -> its last word, as a truthful agent remembers."""
        self.seqs: dict[tuple[str, TaskRef], int] = {}
        self.sent: list[SkillStatus] = []

    @initialize(
        then=st.lists(st.sampled_from(Measure), max_size=3),
        retries=st.integers(0, 2),
        lost_after_s=st.sampled_from([None, 10.0, 50.0]),
    )
    def open(self, then: list[Measure], retries: int, lost_after_s: float | None) -> None:
        """Begin with some failure policy."""
        default = FailurePolicy(then=tuple(then), retries=retries)
        self.policy = Policy(failures=FailurePolicies(default=default, lost_after_s=lost_after_s))
        self.yard = Yard(SITE, policy=self.policy)
        self.yard.open()

    def _pick_task(self, index: int) -> tuple[str, Task] | None:
        active = [
            (run.robot_id, task)
            for mission in self.missions
            for task_id in sorted(mission.active)
            for task in [mission.tasks[task_id]]
            for run in task.runs.values()
        ]
        return active[index % len(active)] if active else None

    @rule(plan=plans(), priority=st.integers(0, 9), ask=st.booleans())
    def submit(self, plan: tuple[PlanTask, ...], priority: int, *, ask: bool) -> None:
        """Someone submits a mission."""
        if self.yard.core.state.submitted < 6:
            self.missions.append(self.yard.submit(*plan, priority=priority, ask=ask))

    @rule()
    def submit_without_a_plan(self) -> None:
        """Someone submits a mission that still has to be planned."""
        if self.yard.core.state.submitted < 6:
            self.missions.append(self.yard.submit())

    @precondition(lambda self: self.missions)
    @rule(index=indexes, action=st.sampled_from(MissionAction), plan=plans())
    def control(self, index: int, action: MissionAction, plan: tuple[PlanTask, ...]) -> None:
        """Someone acts on a mission."""
        mission = self.missions[index % len(self.missions)]
        if not is_possible(mission, action):
            return
        held = [t.task_id for t in mission.tasks.values() if t.awaits is not None]
        task_id = held[index % len(held)] if held and action in DECISIONS else None
        new = Plan(tasks=plan) if action is MissionAction.SET_PLAN else None
        try:
            self.yard.control(mission, action, plan=new, task_id=task_id)
        except NotPossibleError:
            # nothing is to be decided about that task, or there are several new plans to choose from
            assert action in (*DECISIONS, MissionAction.SET_PLAN)

    @precondition(lambda self: self.yard.questions)
    @rule(index=indexes, plan=st.none() | plans(), ask=st.booleans())
    def the_planner_answers(self, index: int, plan: tuple[PlanTask, ...] | None, *, ask: bool) -> None:
        """Answer with a new plan for the rest, or with none."""
        key = sorted(self.yard.questions)[index % len(self.yard.questions)]
        self.yard.answer(key, *(plan or ()), ask_because=("a rule",) if ask else ())

    @rule(index=indexes, kind=st.sampled_from(SkillStatusKind), progress=st.floats(0, 1))
    def a_robot_obeys(self, index: int, kind: SkillStatusKind, progress: float) -> None:
        """Let a robot answer what it is asked; it starts an attempt at most once and never changes its last word."""
        requests = sorted(self.yard.outbox.items(), key=lambda e: (e[0][0], e[0][1].model_dump_json()))
        if not requests:
            return
        (robot_id, ref), request = requests[index % len(requests)]
        known = self.begun.get((robot_id, ref))
        if known is not None and known.final:
            kind = known
        elif known is None and request.action not in (RequestAction.START, RequestAction.PREPARE):
            kind = SkillStatusKind.UNKNOWN
        elif known is None and request.action is RequestAction.PREPARE and not kind.final:
            kind = SkillStatusKind.ACCEPTED
        elif known is None and request.boot_id != self.yard.boots[robot_id]:
            kind = SkillStatusKind.REFUSED
        elif known is not None and kind in (SkillStatusKind.REFUSED, SkillStatusKind.UNKNOWN):
            kind = SkillStatusKind.CANCELLED
        self._say(robot_id, ref, request.skill, kind, progress)

    @rule(index=indexes, kind=st.sampled_from(SkillStatusKind), progress=st.floats(0, 1))
    def a_robot_goes_on(self, index: int, kind: SkillStatusKind, progress: float) -> None:
        """Let a robot that has begun tell how it stands."""
        going = [k for k, last in self.begun.items() if not last.final]
        if going and kind not in (SkillStatusKind.REFUSED, SkillStatusKind.UNKNOWN, SkillStatusKind.ACCEPTED):
            robot_id, ref = going[index % len(going)]
            task = self.yard.core.state.task((ref.mission_id, ref.task_id))
            if task is not None:  # else its mission is in the archive
                self._say(robot_id, ref, task.skill.name, kind, progress)

    def _say(self, robot_id: str, ref: TaskRef, skill: str, kind: SkillStatusKind, progress: float) -> None:
        self.begun[robot_id, ref] = kind
        self.seqs[robot_id, ref] = self.seqs.get((robot_id, ref), 0) + 1
        status = SkillStatus(
            **ref.model_dump(),
            epoch=1,
            robot_id=robot_id,
            boot_id=self.yard.boots[robot_id],
            skill=skill,
            seq=self.seqs[robot_id, ref],
            state=kind,
            progress=progress,
            at=0,
        )
        self.sent.append(status)
        self.yard.hear(status)

    @precondition(lambda self: self.sent)
    @rule(index=indexes)
    def an_old_word_comes_again(self, index: int) -> None:
        """Repeat a message, or deliver it late."""
        self.yard.hear(self.sent[index % len(self.sent)])

    @rule(index=indexes)
    def a_robot_is_lost(self, index: int) -> None:
        """Take a robot's token away."""
        self.yard.robot_lost(SITE.robots[index % len(SITE.robots)].id)

    @rule(index=indexes)
    def a_robot_is_back(self, index: int) -> None:
        """Show the same life again."""
        self.yard.robot_back(SITE.robots[index % len(SITE.robots)].id)

    @rule(index=indexes)
    def an_agent_restarts(self, index: int) -> None:
        """Begin a new life of an agent; what was under way is interrupted."""
        robot_id = SITE.robots[index % len(SITE.robots)].id
        for (other, ref), last in self.begun.items():
            if other == robot_id and not last.final:
                self.begun[other, ref] = SkillStatusKind.INTERRUPTED
        self.yard.robot_comes(robot_id)

    @rule(index=st.integers(-1, len(SITE.robots) - 1), stop=st.booleans())
    def someone_stops_or_releases(self, index: int, *, stop: bool) -> None:
        """Stop or release a robot, or everything."""
        state = self.yard.core.state
        if stop or index < 0 or not state.stopped:
            self.yard.stop(SITE.robots[index].id if index >= 0 else None, stop=stop)

    @precondition(lambda self: self.yard.stops)
    @rule(index=indexes, standing=st.booleans())
    def a_robot_answers_a_stop(self, index: int, *, standing: bool) -> None:
        """Let a robot say whether it stands."""
        self.yard.obey_stop(sorted(self.yard.stops)[index % len(self.yard.stops)], standing=standing)

    @rule(index=indexes)
    def an_object_goes_or_comes(self, index: int) -> None:
        """Have the cameras lose or find something."""
        name = THINGS[index % len(THINGS)]
        if name in self.yard.world.objects:
            self.yard.lose_sight(name)
        else:
            self.yard.see(SITE, [name])

    @rule(seconds=st.sampled_from([0.3, 1.5, 5.0, 40.0, 70.0]))
    def time_passes(self, seconds: float) -> None:
        """Deadlines come."""
        self.yard.wait(seconds)

    @rule(keep=st.integers(0, 2))
    def old_missions_are_archived(self, keep: int) -> None:
        """Let ended missions leave the state."""
        old = [m.mission_id for m in archivable(self.yard.core.state, keep)]
        if old:
            self.yard.happen(MissionsArchived(at=self.yard.now, mission_ids=tuple(old)))
            self.missions = [m for m in self.missions if m.mission_id not in old]

    @rule(index=indexes)
    def the_scheduler_restarts(self, index: int) -> None:
        """Bring it back from its journal, whole or from any snapshot on, as it was, and begin a new epoch."""
        events = [EVENT.validate_json(e.to_json()) for e in self.yard.events]
        since = index % (len(events) + 1)
        again = replayed(events[since:], Core(load(dump(replayed(events[:since]).state))))
        assert replayed(events).state == again.state == self.yard.core.state
        assert again.state.timers == self.yard.core.state.timers
        self.yard.core = again
        self.missions = list(again.state.missions.values())
        self.yard.happen(Started(at=self.yard.now, epoch=again.state.epoch + 1, policy=self.policy))
        self.yard.see(SITE, list(self.yard.world.objects))
        for robot in SITE.robots:
            self.yard.robot_back(robot.id)

    @invariant()
    def robots_and_objects_are_never_asked_for_too_much(self) -> None:
        """No robot is asked to start two attempts at once (area rules aside), and the state is sound."""
        validate(self.yard.core.state)
        starts = [
            (r.robot_id, ref)
            for (_, ref), r in self.yard.outbox.items()
            if r.action is RequestAction.START and "areas" not in r.skill
        ]
        assert len({robot_id for robot_id, _ in starts}) == len(starts)
        assert not [r for r, _ in starts if self.yard.core.state.robots[r].stopped]

    def _answer_everything(self) -> None:
        """Leave no question open: no new plans, and what waits for a decision is left out."""
        for key in list(self.yard.questions):
            self.yard.answer(key)
        for mission in self.missions:
            for task in list(mission.tasks.values()):
                if task.awaits is Awaits.DECISION and is_possible(mission, MissionAction.SKIP):
                    self.yard.control(mission, MissionAction.SKIP, task_id=task.task_id)
            if is_possible(mission, MissionAction.REJECT):
                self.yard.control(mission, MissionAction.REJECT)

    def teardown(self) -> None:
        """When everything works again, every mission ends."""
        for robot in SITE.robots:
            self.yard.robot_comes(robot.id)
            for (other, ref), last in list(self.begun.items()):
                if other == robot.id and not last.final:
                    self.begun[other, ref] = SkillStatusKind.INTERRUPTED
        self.yard.stop(stop=False)
        for robot in SITE.robots:
            self.yard.stop(robot.id, stop=False)
        self.yard.see(SITE)
        for mission in self.missions:
            for action in (MissionAction.REFUSE, MissionAction.REJECT, MissionAction.RESUME):
                if is_possible(mission, action):
                    self.yard.control(mission, action)
        for _ in range(400):
            self._answer_everything()
            if all(m.state.ended for m in self.missions):
                break
            for (robot_id, ref), request in list(self.yard.outbox.items()):
                last = self.begun.get((robot_id, ref))
                answers = {
                    RequestAction.PREPARE: SkillStatusKind.ACCEPTED,
                    RequestAction.START: SkillStatusKind.SUCCEEDED,
                }
                kind = answers.get(request.action, SkillStatusKind.UNKNOWN)
                self._say(robot_id, ref, request.skill, last if last and last.final else kind, 1.0)
            self.yard.wait(1.1)
        stuck = [
            f"{t.mission_id}/{t.task_id} {t.state} {t.waiting_for}: {list(t.story)}"
            for m in self.missions
            if not m.state.ended
            for t in m.tasks.values()
            if not t.state.ended
        ]
        assert not stuck


TestWholeCore = WholeCore.TestCase
TestWholeCore.settings = settings(
    max_examples=40, stateful_step_count=40, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
