"""Missions on the bus become plans, whatever happens in between."""

import asyncio

import httpx
from muster_bus.testing import RouterProcess, eventually
from muster_planner.llm import PlanRequest
from muster_planner.testing import (
    DRIVE,
    NOWHERE,
    Answer,
    FunctionModel,
    one_task,
    running_planner,
    show_objects,
    standing_robots,
)
from muster_schemas.base import Pose
from muster_schemas.channels import KEYWORDS, OBJECT, ROBOT_CARD
from muster_schemas.mission import MissionStatus
from muster_schemas.robot import RobotCard
from muster_schemas.world import Keywords


async def test_missions_that_wait_when_the_planner_starts_are_planned(shared_router: RouterProcess) -> None:
    """Wherever they came from: the scheduler's journal is the queue."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        planner.missions.put("m-orphan", "go to the soil")
        await planner.until("m-orphan", MissionStatus.RUNNING)


async def test_what_cannot_be_planned_is_rejected_with_reasons(shared_router: RouterProcess) -> None:
    """The mission holds what a person reads."""
    async with running_planner(shared_router, FunctionModel(lambda _: "There is no crane here.")) as planner:
        view = await planner.until(await planner.send("hoist"), MissionStatus.REJECTED)
    assert [(r.code, r.message) for r in view.mission.reasons] == [("refused", "There is no crane here.")]


async def test_the_schedulers_reasons_lead_to_a_repair(shared_router: RouterProcess) -> None:
    """What only the scheduler knows goes back to the model."""

    def first_to_soil2(request: PlanRequest) -> Answer:
        if request.feedback:
            return DRIVE
        return one_task("target_area_for_specific_robots", "robot_excavator_01", "soil2")

    model = FunctionModel(first_to_soil2)
    async with running_planner(shared_router, model) as planner:
        view = await planner.until(await planner.send("go"), MissionStatus.RUNNING)
    assert view.plan == DRIVE
    feedback = model.requests[1].feedback
    assert feedback is not None
    assert "soil2" in feedback.reasons[0].message


async def test_one_model_call_at_a_time_and_the_urgent_first(shared_router: RouterProcess) -> None:
    """Priority decides who is next, then the order of arrival."""
    hold = asyncio.Event()

    async def held(_: PlanRequest) -> Answer:
        await hold.wait()
        return DRIVE

    model = FunctionModel(held)
    async with running_planner(shared_router, model) as planner:
        first = await planner.send("first", priority=1)
        await eventually(lambda: len(model.requests) == 1)
        rest = [await planner.send(text, priority=p) for text, p in (("b", 5), ("c", 5), ("urgent", 9))]
        hold.set()
        for mission_id in (first, *rest):
            await planner.until(mission_id, MissionStatus.RUNNING)
    assert [r.text for r in model.requests] == ["first", "urgent", "b", "c"]
    assert model.most_at_once == 1


async def test_a_cancelled_mission_is_not_planned_further(shared_router: RouterProcess) -> None:
    """Its model call is ended, and the next one gets its turn."""
    ended: list[str] = []

    async def forever(request: PlanRequest) -> Answer:
        if request.text != "slow":
            return DRIVE
        try:
            await asyncio.Event().wait()
        finally:
            ended.append(request.text)
        return DRIVE

    model = FunctionModel(forever)
    async with running_planner(shared_router, model) as planner:
        slow = await planner.send("slow")
        await eventually(lambda: model.at_once == 1)
        behind = await planner.send("quick")
        assert (await planner.http.post(f"/missions/{slow}/cancel")).status_code == 200
        await planner.until(behind, MissionStatus.RUNNING)
        assert ended == ["slow"]
        assert planner.missions.state(slow) is MissionStatus.CANCELLED


async def test_a_plan_is_given_once_though_the_scheduler_answers_late(shared_router: RouterProcess) -> None:
    """No answer means nobody knows, so the planner asks what became of it before it says it again."""
    model = FunctionModel(lambda _: DRIVE)
    async with running_planner(shared_router, model) as planner:
        planner.missions.answers_after_s = 8.5  # a plan waits for 8 s
        planner.missions.put("m-late", "go")
        await planner.until("m-late", MissionStatus.RUNNING)
        planner.missions.answers_after_s = 0.0
        done = await planner.send("another")
        await planner.until(done, MissionStatus.RUNNING)
        assert planner.missions.views["m-late"].mission.revision == 2
    assert [r.text for r in model.requests] == ["go", "another"]


async def test_a_fault_in_one_mission_does_not_end_the_others(shared_router: RouterProcess) -> None:
    """It is rejected with a reason, and the planner goes on."""

    def fail(request: PlanRequest) -> Answer:
        if request.text == "boom":
            raise ZeroDivisionError
        return DRIVE

    async with running_planner(shared_router, FunctionModel(fail)) as planner:
        boom = await planner.until(await planner.send("boom"), MissionStatus.REJECTED)
        await planner.until(await planner.send("go"), MissionStatus.RUNNING)
    assert boom.mission.reasons[0].code == "planner_fault"


async def test_robots_that_are_gone_are_not_in_the_roster(shared_router: RouterProcess) -> None:
    """Only those with a card whose life holds its token; a new one is there at once."""
    model = FunctionModel(lambda _: "no")
    stranger = RobotCard(
        robot_id="robot_crane_01",
        boot_id="boot-1",
        type="crane",
        skills=(),
        home=Pose(x=0, y=0),
        length_m=2,
        width_m=2,
        max_speed_mps=1,
    )
    async with running_planner(shared_router, model) as planner:
        planner.bus.publish(ROBOT_CARD, stranger, robot_id=stranger.robot_id)
        await eventually(lambda: _fleet(planner.http, {"robot_crane_01": False}))
        await planner.http.post("/instructions", json={"text": "go", "dry_run": True})
    assert "robot_crane_01" not in [c.robot_id for c in model.requests[0].roster]
    assert len(model.requests[0].roster) == 6


async def test_a_restarted_robot_is_in_the_roster_by_its_new_life(shared_router: RouterProcess) -> None:
    """A token of the life before does not count."""
    model = FunctionModel(lambda _: "no")
    async with running_planner(shared_router, model) as planner:
        card = (await planner.http.get("/fleet")).json()["robots"][0]
        reborn = RobotCard.model_validate({**card, "boot_id": "boot-2"})
        planner.bus.publish(ROBOT_CARD, reborn, robot_id=reborn.robot_id)
        await eventually(lambda: _fleet(planner.http, {reborn.robot_id: False}))
        async with standing_robots(planner.bus, []):
            await planner.http.post("/instructions", json={"text": "go", "dry_run": True})
    assert reborn.robot_id not in [c.robot_id for c in model.requests[0].roster]


async def test_an_object_that_the_map_lacks_is_looked_for(shared_router: RouterProcess) -> None:
    """Keywords go to the cameras; what they find within the wait makes the plan possible."""
    model = FunctionModel(lambda _: NOWHERE)
    asked: list[Keywords] = []
    async with running_planner(shared_router, model) as planner, planner.bus.subscribe(KEYWORDS) as messages:

        async def cameras() -> None:
            async for received in messages:
                assert received.message is not None
                asked.append(received.message)
                show_objects(planner.bus, "puddle7")

        looking = asyncio.create_task(cameras())
        answer = await planner.http.post("/instructions", json={"text": "go there", "dry_run": True})
        looking.cancel()
    assert answer.status_code == 200
    assert [k.keywords for k in asked] == [("puddle",)]
    assert asked[0].asked_by == "planner"


async def test_an_object_that_nobody_finds_is_a_reason_after_the_wait(shared_router: RouterProcess) -> None:
    """The rejection names it and what was seen."""
    async with running_planner(shared_router, FunctionModel(lambda _: NOWHERE)) as planner:
        view = await planner.until(await planner.send("go there"), MissionStatus.REJECTED)
    assert "puddle7" in view.mission.reasons[0].message
    assert "soil1" in view.mission.reasons[0].message


async def test_objects_that_left_the_map_are_not_offered(shared_router: RouterProcess) -> None:
    """The model hears of what is there now."""
    model = FunctionModel(lambda _: "no")
    async with running_planner(shared_router, model) as planner:
        planner.bus.retract(OBJECT, object_name="rock1")
        await eventually(lambda: _without(planner.http, "rock1"))
        await planner.http.post("/instructions", json={"text": "go", "dry_run": True})
    assert "rock1" not in model.requests[0].objects
    assert "soil1" in model.requests[0].objects


async def _fleet(http: httpx.AsyncClient, wanted: dict[str, bool]) -> bool:
    robots = (await http.get("/fleet")).json()["robots"]
    return wanted.items() <= {r["robot_id"]: r["online"] for r in robots}.items()


async def _without(http: httpx.AsyncClient, name: str) -> bool:
    return name not in [o["name"] for o in (await http.get("/objects")).json()["objects"]]
