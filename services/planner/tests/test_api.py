"""The REST API over real HTTP and a real bus."""

import asyncio

import httpx
from muster_bus.testing import RouterProcess, eventually
from muster_planner.testing import DRIVE, NOWHERE, FunctionModel, Planner, running_planner, standing_robots
from muster_schemas.channels import AREAS, TASK_STATE
from muster_schemas.mission import MissionStatus, MissionView, TaskState, TaskStatus
from muster_schemas.world import AreaRules


async def test_an_instruction_becomes_a_mission_with_a_plan(shared_router: RouterProcess) -> None:
    """202 with the mission's id at once; the plan follows."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        answer = await planner.http.post("/instructions", json={"text": "go to the soil", "priority": 7})
        assert answer.status_code == 202
        assert answer.json()["state"] == "planning"
        await planner.until(answer.json()["mission_id"], MissionStatus.RUNNING)
        read = (await planner.http.get(f"/missions/{answer.json()['mission_id']}")).json()
    assert read["text"] == "go to the soil"
    assert read["priority"] == 7
    assert read["plan"]["tasks"][0]["instruction_function"] == {
        "name": "target_area_for_specific_robots",
        "robot_ids": ["robot_excavator_01"],
        "dependencies": [],
        "object_keywords": ["soil1"],
    }


async def test_a_dry_run_answers_the_plan_and_makes_no_mission(shared_router: RouterProcess) -> None:
    """200 with the plan; the scheduler hears nothing."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        answer = await planner.http.post("/instructions", json={"text": "go to the soil", "dry_run": True})
        assert answer.status_code == 200
        assert [t["task"] for t in answer.json()["plan"]["tasks"]] == ["only"]
        assert planner.missions.views == {}


async def test_a_dry_run_of_what_cannot_be_planned_says_why(shared_router: RouterProcess) -> None:
    """422 as problem details with the model's refusal."""
    async with running_planner(shared_router, FunctionModel(lambda _: "There is no crane here.")) as planner:
        answer = await planner.http.post("/instructions", json={"text": "hoist the crane", "dry_run": True})
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["detail"] == "There is no crane here."


async def test_the_same_idempotency_key_makes_one_mission(shared_router: RouterProcess) -> None:
    """The second request returns the mission of the first; another text under the key is refused."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        key = {"Idempotency-Key": "shift-7-order-3"}
        first = await planner.http.post("/instructions", json={"text": "go"}, headers=key)
        again = await planner.http.post("/instructions", json={"text": "go"}, headers=key)
        other = await planner.http.post("/instructions", json={"text": "stop"}, headers=key)
        assert again.status_code == first.status_code == 202
        assert again.json()["mission_id"] == first.json()["mission_id"]
        assert other.status_code == 422
        assert other.json()["code"] == "key_reused"
        assert len(planner.missions.views) == 1


async def test_a_plan_is_edited_and_approved(shared_router: RouterProcess) -> None:
    """With approval `ask` the plan waits; a person may replace it, and only then."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        mission_id = await planner.send("go", approval="ask")
        await planner.until(mission_id, MissionStatus.AWAITING_APPROVAL)
        edited = DRIVE.model_dump(mode="json")
        edited["tasks"][0]["instruction_function"]["robot_ids"] = ["robot_excavator_02"]
        assert (await planner.http.put(f"/missions/{mission_id}/plan", json=edited)).status_code == 200
        bad = await planner.http.put(f"/missions/{mission_id}/plan", json=NOWHERE.model_dump(mode="json"))
        assert bad.status_code == 422
        assert bad.json()["reasons"][0]["code"] == "unknown_object"
        approved = await planner.http.post(f"/missions/{mission_id}/approve")
        assert (approved.status_code, approved.json()["state"]) == (200, "running")
        late = await planner.http.put(f"/missions/{mission_id}/plan", json=edited)
        assert late.status_code == 409
        plan = planner.missions.views[mission_id].plan
    assert plan is not None
    assert plan.tasks[0].instruction_function.robot_ids == ("robot_excavator_02",)


async def test_actions_change_the_state_or_conflict(shared_router: RouterProcess) -> None:
    """Each action answers the new state; one that cannot be done answers 409 and says where the mission stands."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        mission_id = await planner.send("go")
        await planner.until(mission_id, MissionStatus.RUNNING)
        answers = [await planner.http.post(f"/missions/{mission_id}/{a}") for a in ("pause", "resume", "cancel")]
        late = await planner.http.post(f"/missions/{mission_id}/approve")
    assert [(a.status_code, a.json()["state"]) for a in answers] == [
        (200, "paused"),
        (200, "running"),
        (200, "cancelled"),
    ]
    assert late.status_code == 409
    assert "cancelled" in late.json()["detail"]


async def test_unknown_missions_are_404(shared_router: RouterProcess) -> None:
    """Reading, acting and editing alike."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        answers = [
            await planner.http.get("/missions/m-none"),
            await planner.http.post("/missions/m-none/cancel"),
            await planner.http.put("/missions/m-none/plan", json=DRIVE.model_dump(mode="json")),
        ]
    assert [a.status_code for a in answers] == [404, 404, 404]
    assert {a.headers["content-type"] for a in answers} == {"application/problem+json"}


async def test_missions_are_listed_by_state(shared_router: RouterProcess) -> None:
    """Newest first; `state` and `limit` narrow it down."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        waiting = await planner.send("one", approval="ask")
        running = await planner.send("two")
        await planner.until(waiting, MissionStatus.AWAITING_APPROVAL)
        await planner.until(running, MissionStatus.RUNNING)
        every = (await planner.http.get("/missions")).json()["missions"]
        one = (await planner.http.get("/missions?state=awaiting_approval&limit=5")).json()["missions"]
    assert [m["mission_id"] for m in every] == [running, waiting]
    assert [m["mission_id"] for m in one] == [waiting]


async def test_a_mission_shows_its_tasks(shared_router: RouterProcess) -> None:
    """Each task with its state, robots, what it waits for, attempts, times and error."""
    task = TaskState(
        mission_id="m-1",
        task_id="t1",
        revision=3,
        name="only",
        skill="excavator_digging",
        state=TaskStatus.WAITING,
        waiting_for=("robot: robot_excavator_01",),
        attempt=2,
    )
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        mission_id = await planner.send("go")
        await planner.until(mission_id, MissionStatus.RUNNING)
        view = planner.missions.views[mission_id]
        planner.missions.views[mission_id] = MissionView(mission=view.mission, plan=view.plan, tasks=(task,))
        read = (await planner.http.get(f"/missions/{mission_id}")).json()["tasks"]
    assert len(read) == 1
    assert read[0].items() >= {"task_id": "t1", "state": "waiting", "attempts": 2, "error": None}.items()
    assert read[0]["waiting_for"] == ["robot: robot_excavator_01"]


async def test_fleet_objects_and_areas_are_what_the_bus_says(shared_router: RouterProcess) -> None:
    """Cards and tokens, the object map, and the area rules."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE), objects=("rock1", "soil1")) as planner:
        planner.bus.publish(AREAS, AreaRules(revision=4))
        await eventually(lambda: _is(planner.http, "/areas", {"revision": 4, "rules": []}))
        fleet = (await planner.http.get("/fleet")).json()["robots"]
        objects = (await planner.http.get("/objects")).json()["objects"]
    assert len(fleet) == 6
    assert fleet[0].items() >= {"robot_id": "robot_dump_truck_01", "type": "dump_truck", "online": True}.items()
    assert [(o["name"], o["class"]) for o in objects] == [("rock1", "rock"), ("soil1", "soil")]


async def test_events_stream_missions_tasks_and_robots(shared_router: RouterProcess) -> None:
    """A listener hears of each change, as the JSON of what has changed."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        heard: list[str] = []

        async def listen() -> None:
            async with planner.http.stream("GET", "/events") as stream:
                heard.append("connected")
                async for line in stream.aiter_lines():
                    heard.append(line)  # noqa: PERF401 (others read the list while it grows)

        listening = asyncio.create_task(listen())
        await eventually(lambda: "connected" in heard)
        mission_id = await planner.send("go")
        await planner.until(mission_id, MissionStatus.RUNNING)
        state = TaskState(
            mission_id=mission_id, task_id="t1", revision=0, name="only", skill="x", state=TaskStatus.READY
        )
        planner.bus.publish(TASK_STATE, state, mission_id=mission_id, task_id="t1")
        async with standing_robots(planner.bus, ["robot_excavator_03"]):
            await eventually(lambda: {"event: mission", "event: task", "event: robot"} <= set(heard))
        listening.cancel()
    assert any(mission_id in line and '"state":"running"' in line for line in heard if line.startswith("data: "))


async def test_health_readiness_and_metrics(shared_router: RouterProcess) -> None:
    """Alive and ready; what was planned is counted."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        mission_id = await planner.send("go")
        await planner.until(mission_id, MissionStatus.RUNNING)
        assert (await planner.http.get("/healthz")).json() == {"status": "ok"}
        assert (await planner.http.get("/readyz")).json()["status"] == "ready"
        await eventually(lambda: _counted(planner))


async def test_the_docs_page_needs_nothing_from_elsewhere(shared_router: RouterProcess) -> None:
    """It lists every call and loads no script, style or font."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        page = (await planner.http.get("/docs")).text
        described = (await planner.http.get("/openapi.json")).json()
    assert all(path in page for path in described["paths"])
    assert "<script" not in page
    assert "http" not in page.replace("application/problem", "").replace("HTTP", "").split("<h2>Models")[0]


async def _is(http: httpx.AsyncClient, path: str, value: object) -> bool:
    return (await http.get(path)).json() == value


async def _counted(planner: Planner) -> bool:
    return 'muster_planner_instructions_total{outcome="planned"} 1.0' in (await planner.http.get("/metrics")).text


async def test_robots_are_stopped_and_released_each_or_all(shared_router: RouterProcess) -> None:
    """The answer says per robot what is known; a robot that does not exist is a 404."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        answer = await planner.http.post("/stop")
        assert answer.status_code == 200
        assert answer.json()["site_stopped"]
        assert set(answer.json()["robots"].values()) == {"was idle"}
        answer = await planner.http.post("/robots/robot_excavator_01/stop")
        assert answer.json()["robots"] == {"robot_excavator_01": "was idle"}
        answer = await planner.http.post("/robots/robot_excavator_01/release")
        assert answer.json()["robots"] == {"robot_excavator_01": "released"}
        assert (await planner.http.post("/release")).status_code == 200
        assert (await planner.http.post("/robots/robot_nobody/stop")).status_code == 404


async def test_an_edit_of_a_plan_that_changed_meanwhile_is_refused(shared_router: RouterProcess) -> None:
    """409 and nothing changes; with the revision of now it is taken."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        mission_id = await planner.send("go to the soil", approval="ask")
        await planner.until(mission_id, MissionStatus.AWAITING_APPROVAL)
        path = f"/missions/{mission_id}"
        read = (await planner.http.get(path)).json()
        now = read["plan_revision"]
        stale = await planner.http.put(f"{path}/plan", params={"plan_revision": now + 1}, json=read["plan"])
        assert stale.status_code == 409
        taken = await planner.http.put(f"{path}/plan", params={"plan_revision": now}, json=read["plan"])
        assert taken.status_code == 200
        assert (await planner.http.post(f"{path}/approve", params={"plan_revision": now})).status_code == 409
