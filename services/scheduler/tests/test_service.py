"""The scheduler as a process on a real bus, with simulated robots."""

import contextlib
from collections.abc import AsyncGenerator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from muster_bus import Bus, NoReplyError, RefusedError
from muster_bus.testing import Process, RouterProcess, eventually, running_bus, service_process
from muster_scheduler.testing import planned, yard_file
from muster_scheduler.testing_agents import SimulatedAgent, crew
from muster_schemas.channels import CONTROL, MISSION_STATE, MISSIONS, REPLAN, RULES, STOP, SUBMIT, TASK_STATE
from muster_schemas.mission import MissionStatus, MissionView, TaskState, TaskStatus
from muster_schemas.plan import Plan, PlanTask
from muster_schemas.policies import FailurePolicy, Measure
from muster_schemas.robot import SkillStatus, SkillStatusKind, TaskRef
from muster_schemas.rpc import (
    ControlMission,
    ControlReply,
    ErrorCode,
    MissionAction,
    MissionsQuery,
    MissionsReply,
    ReplanMission,
    ReplanReply,
    RulesQuery,
    SubmitMission,
)
from muster_schemas.site import load_site
from muster_schemas.stops import NO_ANSWER, StopReply, StopRobots
from muster_schemas.world import AreaRules

SITE = load_site(yard_file())
ASK_S = 120
"""Generous: tests run beside other work on few cores."""
E1, E2, T1 = "robot_excavator_01", "robot_excavator_02", "robot_dump_truck_01"
GO, DIG, DUMP, AVOID = (
    "target_area_for_specific_robots",
    "Excavation",
    "ExcavatorUnloading",
    "avoid_areas_for_specific_robots",
)


@dataclass
class Site:
    """A running scheduler with a crew."""

    router: RouterProcess
    data_dir: Path
    bus: Bus
    agents: dict[str, SimulatedAgent]
    process: Process
    stack: contextlib.AsyncExitStack = field(default_factory=contextlib.AsyncExitStack)

    async def submit(self, *tasks: PlanTask, **rest: object) -> str:
        """Make a mission and return its id."""
        request = SubmitMission.model_validate({"text": "do it", "plan": Plan(tasks=tasks), **rest})
        reply: ControlReply = await self.bus.ask(SUBMIT, request, timeout_s=ASK_S)
        return reply.mission_id

    async def control(self, mission_id: str, action: MissionAction) -> ControlReply:
        """Act on a mission."""
        return await self.bus.ask(CONTROL, ControlMission(mission_id=mission_id, action=action), timeout_s=ASK_S)

    async def view(self, mission_id: str) -> MissionView:
        """Return a mission with its tasks."""
        reply: MissionsReply = await self.bus.ask(MISSIONS, MissionsQuery(mission_id=mission_id), timeout_s=ASK_S)
        return reply.missions[0]

    async def missions(self) -> int:
        """Return how many missions there are."""
        reply: MissionsReply = await self.bus.ask(MISSIONS, MissionsQuery(limit=1000), timeout_s=ASK_S)
        return len(reply.missions)

    async def reaches(self, mission_id: str, *states: MissionStatus) -> MissionView:
        """Wait until a mission is in one of these states; a scheduler that is away meanwhile is waited for."""

        async def there() -> MissionView | None:
            with contextlib.suppress(NoReplyError):
                view = await self.view(mission_id)
                if view.mission.state in states:
                    return view
            return None

        view = await eventually(there, within_s=240)
        assert view is not None
        return view

    async def restart(self) -> None:
        """Kill the scheduler as a power cut would and start it again."""
        await self.process.kill()
        self.process = await self.stack.enter_async_context(
            service_process("muster_scheduler", self.router, {"MUSTER_DATA_DIR": str(self.data_dir)})
        )
        await self.process.until_logged("serving")

    def order(self) -> list[tuple[str, str]]:
        """Return ('start' or 'end', task id) of all robots in the order of time."""
        happened = sorted((at, what, r.task_id) for a in self.agents.values() for at, what, r in a.log)
        return [(what, task_id) for _, what, task_id in happened]

    def starts(self) -> list[int]:
        """Return how often each attempt was started."""
        return [n for a in self.agents.values() for n in a.started.values()]


@pytest.fixture
async def site(router: RouterProcess, tmp_path: Path) -> AsyncGenerator[Site]:
    """Provide a running scheduler with all the robots of the default site, all of them seen."""
    async with contextlib.AsyncExitStack() as stack:
        bus = await stack.enter_async_context(running_bus(router))
        agents = await stack.enter_async_context(crew(bus, SITE))
        env = {"MUSTER_DATA_DIR": str(tmp_path)}
        process = await stack.enter_async_context(service_process("muster_scheduler", router, env))
        await process.until_logged("serving")
        yield Site(router, tmp_path, bus, agents, process, stack)


def diamond() -> tuple[PlanTask, ...]:
    """Return t1, then t2 and t3 in parallel, then t4."""
    return (
        planned("drive", GO, [E1, T1], objects=["soil1"]),
        planned("dig", DIG, [E1], after=["drive"]),
        planned("on", GO, [T1], after=["drive"], objects=["puddle1"]),
        planned("meet", GO, [E1, T1], after=["dig", "on"], objects=["rock1"]),
    )


async def test_a_diamond_runs_in_order_and_its_branches_in_parallel(site: Site) -> None:
    """The second layer starts after the first has ended, both branches overlap, and the last comes last."""
    branches = {E1: "t2", T1: "t3"}
    for robot_id, task_id in branches.items():
        site.agents[robot_id].held.add(task_id)
    mission_id = await site.submit(*diamond())
    await eventually(lambda: {("start", task_id) for task_id in branches.values()} <= set(site.order()))
    for robot_id in branches:
        site.agents[robot_id].held.clear()
    view = await site.reaches(mission_id, MissionStatus.SUCCEEDED, MissionStatus.FAILED)
    assert view.mission.state is MissionStatus.SUCCEEDED
    order = site.order()
    assert [t for _, t in order[:4]] == ["t1"] * 4
    assert {t for what, t in order[4:6] if what == "start"} == {"t2", "t3"}
    assert [t for _, t in order[8:]] == ["t4"] * 4
    assert set(site.starts()) == {1}


async def test_a_killed_scheduler_finishes_what_it_began(site: Site) -> None:
    """After kill -9 in the middle of a mission it resumes by itself, and no attempt is started twice."""
    site.agents[E1].hold.clear()
    mission_id = await site.submit(*diamond())
    await eventually(lambda: site.agents[E1].started)
    await site.restart()
    site.agents[E1].hold.set()
    view = await site.reaches(mission_id, MissionStatus.SUCCEEDED, MissionStatus.FAILED)
    assert view.mission.state is MissionStatus.SUCCEEDED
    assert set(site.starts()) == {1}
    assert max(r.epoch for r in site.agents[E1].requests) == 2


async def test_a_word_said_while_the_scheduler_was_dead_counts(site: Site) -> None:
    """A robot that ends its task while nobody listens repeats it, and the mission goes on from there."""
    site.agents[E1].hold.clear()
    mission_id = await site.submit(planned("go", GO, [E1], objects=["soil1"]), planned("dig", DIG, [E1], after=["go"]))
    await eventually(lambda: site.agents[E1].started)
    await site.process.kill()
    site.agents[E1].hold.set()
    await eventually(lambda: site.agents[E1].unacked)
    await site.restart()
    await site.reaches(mission_id, MissionStatus.SUCCEEDED)
    await eventually(lambda: not site.agents[E1].unacked)
    assert set(site.starts()) == {1}


async def test_words_that_come_twice_late_or_for_nobody_change_nothing(site: Site) -> None:
    """Duplicates, old attempts and foreign missions are acknowledged and otherwise ignored."""
    agent = site.agents[E1]
    agent.copies = 3
    mission_id = await site.submit(planned("go", GO, [E1], objects=["soil1"]), planned("dig", DIG, [E1], after=["go"]))
    await site.reaches(mission_id, MissionStatus.SUCCEEDED)
    revision = (await site.view(mission_id)).tasks[0].revision
    late = SkillStatus(
        mission_id=mission_id,
        task_id="t1",
        attempt=1,
        epoch=1,
        robot_id=E1,
        boot_id=agent.card.boot_id,
        skill=GO,
        seq=99,
        state=SkillStatusKind.FAILED,
        at=0,
    )
    foreign = late.model_copy(update={"mission_id": "m-nobody"})
    for status in (late, foreign, late.model_copy(update={"attempt": 7})):
        ref = TaskRef(mission_id=status.mission_id, task_id=status.task_id, attempt=status.attempt)
        agent.unacked[ref] = status
    await eventually(lambda: not agent.unacked)
    view = await site.view(mission_id)
    assert view.mission.state is MissionStatus.SUCCEEDED
    assert view.tasks[0].revision == revision
    assert set(site.starts()) == {1}


async def test_cancel_stops_the_robots_and_says_so(site: Site) -> None:
    """The reply names each robot; nothing starts afterwards; a second cancel gets the same answer."""
    for agent in site.agents.values():
        agent.hold.clear()
    mission_id = await site.submit(*diamond())
    await eventually(lambda: site.agents[E1].started and site.agents[T1].started)
    reply = await site.control(mission_id, MissionAction.CANCEL)
    assert reply.robots == {E1: "stopped", T1: "stopped"}
    assert reply.state is MissionStatus.CANCELLED
    assert await site.control(mission_id, MissionAction.CANCEL) == reply
    assert len(site.starts()) == 2


async def test_a_second_scheduler_is_refused(site: Site, tmp_path: Path) -> None:
    """Neither beside the first on the bus nor on its journal may another one work."""
    for data_dir in (site.data_dir, tmp_path / "other"):
        env = {"MUSTER_DATA_DIR": str(data_dir)}
        async with service_process("muster_scheduler", site.router, env, wait=False) as second:
            assert await second.ended(within_s=240) in (69, 74)
    assert await site.missions() == 0


BAD_PLANS: dict[str, tuple[list[PlanTask], str]] = {
    "cycle": (
        [planned("a", DIG, [E1], after=["b"]), planned("b", DIG, [E1], after=["a"])],
        "cycle",
    ),
    "itself": ([planned("a", DIG, [E1], after=["a"])], "cycle"),
    "empty": ([], "empty_plan"),
    "unknown robot": ([planned("a", DIG, ["robot_excavator_99"])], "unknown_robot"),
    "unknown skill": ([planned("a", "fly", [E1])], "unknown_skill"),
    "unknown object": ([planned("a", GO, [E1], objects=["castle1"])], "unknown_object"),
    "wrong robot": ([planned("a", DIG, [T1])], "wrong_type"),
    "unknown dependency": ([planned("a", DIG, [E1], after=["z"])], "unknown_dependency"),
    "no object": ([planned("a", GO, [E1])], "object_missing"),
    "too many robots": ([planned("a", DIG, types=["excavator"], count=4)], "too_few_robots"),
    "one name twice": ([planned("a", DIG, [E1]), planned("a", DIG, [E2])], "repeated_name"),
}


async def test_plans_that_cannot_run_are_refused_with_the_reason(site: Site) -> None:
    """Nothing of them reaches a robot or the list of missions."""
    for name, (tasks, code) in BAD_PLANS.items():
        with pytest.raises(RefusedError) as refused:
            await site.submit(*tasks)
        assert refused.value.error.code is ErrorCode.INVALID, name
        assert code in {r.code for r in refused.value.error.reasons}, name
    assert await site.missions() == 0
    assert not site.starts()


async def test_an_idempotency_key_makes_one_mission_even_over_a_restart(site: Site) -> None:
    """The same key again returns the first mission."""
    task = planned("dig", DIG, [E1])
    first = await site.submit(task, idempotency_key="k1")
    assert await site.submit(task, idempotency_key="k1") == first
    await site.restart()
    assert await site.submit(task, idempotency_key="k1") == first
    assert await site.missions() == 1


async def test_rules_hold_over_a_restart_and_late_joiners_get_all_states(site: Site) -> None:
    """Area rules persist; a subscriber that comes late gets the last state of missions and tasks."""
    mission_id = await site.submit(planned("keep out", AVOID, [E1, T1], objects=["puddle1"]))
    await site.reaches(mission_id, MissionStatus.SUCCEEDED)
    await site.restart()
    rules: AreaRules = await site.bus.ask(RULES, RulesQuery(), timeout_s=ASK_S)
    assert {(r.robot_id, r.object_name) for r in rules.rules} == {(E1, "puddle1"), (T1, "puddle1")}
    async with site.bus.subscribe(MISSION_STATE) as missions, site.bus.subscribe(TASK_STATE) as tasks:
        mission = await anext(aiter(missions))
        task = await anext(aiter(tasks))
    assert mission.message is not None
    assert mission.message.state is MissionStatus.SUCCEEDED
    assert isinstance(task.message, TaskState)
    assert task.message.robots == (E1, T1)


async def test_a_mission_waits_for_its_planner_and_for_approval(site: Site) -> None:
    """Without a plan it is planning; with approval asked for, the plan waits for a person, then runs."""
    request = SubmitMission(text="dig", approval="ask")
    reply: ControlReply = await site.bus.ask(SUBMIT, request, timeout_s=ASK_S)
    assert reply.state is MissionStatus.PLANNING
    plan = Plan(tasks=(planned("dig", DIG, [E1]),))
    set_plan = ControlMission(mission_id=reply.mission_id, action=MissionAction.SET_PLAN, plan=plan)
    reply = await site.bus.ask(CONTROL, set_plan, timeout_s=ASK_S)
    assert reply.state is MissionStatus.AWAITING_APPROVAL
    assert (await site.view(reply.mission_id)).tasks[0].waiting_for == ("approval",)
    assert (await site.control(reply.mission_id, MissionAction.APPROVE)).state is MissionStatus.RUNNING
    await site.reaches(reply.mission_id, MissionStatus.SUCCEEDED)
    with pytest.raises(RefusedError) as refused:
        await site.control(reply.mission_id, MissionAction.PAUSE)
    assert refused.value.error.code is ErrorCode.CONFLICT


async def test_a_stop_is_answered_per_robot_and_outlives_the_scheduler(site: Site) -> None:
    """At work, idle and silent robots are told apart; after kill -9 the scheduler goes on asking the silent one."""

    async def stands(wanted: dict[str, str]) -> bool:
        reply: StopReply = await site.bus.ask(STOP, StopRobots(), timeout_s=ASK_S)
        return reply.site_stopped and wanted.items() <= reply.robots.items()

    site.agents[E1].hold.clear()
    site.agents[E2].deaf = True
    mission_id = await site.submit(planned("dig", DIG, [E1]), planned("go", GO, [E1], after=["dig"], objects=["soil1"]))
    await eventually(lambda: site.agents[E1].started)
    await eventually(lambda: stands({E1: "stopped", T1: "was idle", E2: NO_ANSWER}), within_s=60)
    await site.restart()
    site.agents[E1].hold.set()
    site.agents[E2].deaf = False

    await eventually(lambda: stands({E1: "stopped", T1: "was idle", E2: "was idle"}), within_s=60)
    assert site.agents[E2].stopped
    with pytest.raises(RefusedError) as refused:
        await site.bus.ask(STOP, StopRobots(robot_id=E1, stop=False), timeout_s=ASK_S)
    assert refused.value.error.code is ErrorCode.CONFLICT
    assert len(site.starts()) == 1
    reply: StopReply = await site.bus.ask(STOP, StopRobots(stop=False), timeout_s=ASK_S)
    assert not reply.site_stopped
    view = await site.reaches(mission_id, MissionStatus.SUCCEEDED, MissionStatus.FAILED)
    assert view.mission.state is MissionStatus.SUCCEEDED
    assert set(site.starts()) == {1}


async def test_the_planner_is_asked_for_the_rest_also_by_the_next_life(site: Site) -> None:
    """A new plan that cannot run is refused by the gate; the question of a killed scheduler is asked again."""
    asked: list[ReplanMission] = []

    async def plan(question: ReplanMission) -> ReplanReply:
        asked.append(question)
        return ReplanReply(plan=Plan(tasks=(planned("again", DIG, [E2]),)))

    policy = FailurePolicy(then=(Measure.REPLAN,))
    site.agents[E1].fails = "nothing to dig"
    dig = planned("dig", DIG, [E1]).model_copy(update={"on_failure": policy})
    mission_id = await site.submit(dig)

    async def waits() -> bool:
        return any(w.startswith("replan: ") for w in (await site.view(mission_id)).tasks[0].waiting_for)

    await eventually(waits, within_s=60)
    await site.restart()
    async with site.bus.serve(REPLAN, plan):
        view = await site.reaches(mission_id, MissionStatus.SUCCEEDED, MissionStatus.FAILED)
    assert view.mission.state is MissionStatus.SUCCEEDED
    assert [t.state for t in view.tasks] == [TaskStatus.FAILED, TaskStatus.SUCCEEDED]
    assert "nothing to dig" in asked[0].error
    assert set(site.starts()) == {1}
