"""An instruction to its end: real planner, scheduler and robot-agent processes; the model behind an Ollama server."""

import json
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from muster_bus.testing import RouterProcess, eventually, running_bus, service_process
from muster_planner.testing import YARD, show_objects
from muster_planner.testing_servers import model_server, says

HAUL = {
    "tasks": [
        {
            "task": "drive",
            "instruction_function": {
                "name": "target_area_for_specific_robots",
                "robot_ids": ["robot_excavator_01"],
                "dependencies": [],
                "object_keywords": ["soil1"],
            },
        },
        {
            "task": "meanwhile",
            "instruction_function": {
                "name": "target_area_for_specific_robots",
                "robot_type": ["dump_truck"],
                "robot_count": 2,
                "dependencies": [],
                "object_keywords": ["rock1"],
            },
        },
        {
            "task": "home",
            "instruction_function": {
                "name": "return_to_start_for_specific_robots",
                "robot_ids": ["robot_excavator_01"],
                "dependencies": ["drive"],
                "object_keywords": [],
            },
        },
    ]
}
IMPOSSIBLE = json.loads(json.dumps(HAUL).replace("robot_excavator_01", "robot_crane_01"))


@pytest.fixture
def data(tmp_path: Path) -> dict[str, str]:
    """Provide where the site's processes keep their journals."""
    return {"MUSTER_DATA_DIR": str(tmp_path)}


@asynccontextmanager
async def whole_site(
    router: RouterProcess, data: dict[str, str], planner: dict[str, str]
) -> AsyncGenerator[httpx.AsyncClient]:
    """Run a site with kinematic robots, with every robot and thing there; yields a client of its planner."""
    everyone = ",".join(r.id for r in YARD.robots)
    agents = {"MUSTER_ROBOT_ID": everyone, "MUSTER_DRIVER": "kinematic", "MUSTER_SPEED_FACTOR": "20"}
    async with (
        running_bus(router) as cameras,
        service_process("muster_scheduler", router, data),
        service_process("muster_robot_agent", router, data | agents),
        service_process("muster_planner", router, data | planner | {"MUSTER_PORT": "0"}) as process,
    ):
        show_objects(cameras)
        port = (await process.until_logged("listening"))["port"]
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=120) as http:
            await eventually(lambda: _all_there(http), within_s=300)
            yield http


@pytest.mark.end_to_end
async def test_an_instruction_is_planned_repaired_and_carried_out(router: RouterProcess, data: dict[str, str]) -> None:
    """The first plan names a robot that is not there, the second runs to its end; a refusal is rejected."""
    with model_server() as model:
        model.answers = [says(IMPOSSIBLE), says(HAUL), says({"refusal": "There is no crane."})]
        planner = {"MUSTER_PLANNER": "ollama:llama3.1", "OLLAMA_HOST": model.url}
        async with whole_site(router, data, planner) as http:
            done = await _sent_and_ended(http, "haul")
            rejected = await _sent_and_ended(http, "hoist the crane")
    assert done["state"] == "succeeded", done
    assert [t["state"] for t in done["tasks"]] == ["succeeded"] * 3
    assert rejected["state"] == "rejected"
    assert rejected["reasons"][0]["message"] == "There is no crane."
    assert "robot_crane_01" in model.requests[1]["messages"][3]["content"]


@pytest.mark.end_to_end
async def test_the_embedded_model_plans_what_the_robots_then_do(router: RouterProcess, data: dict[str, str]) -> None:
    """The default planner, with nothing but this site's own processes."""
    async with whole_site(router, data, {}) as http:
        done = await _sent_and_ended(http, "Truck 2 drives to puddle 1, then it goes home.")
    assert done["state"] == "succeeded", done
    assert {r for t in done["tasks"] for r in t["robots"]} == {"robot_dump_truck_02"}


async def _sent_and_ended(http: httpx.AsyncClient, text: str) -> dict[str, Any]:
    sent = await http.post("/instructions", json={"text": text})
    assert sent.status_code == 202, sent.text
    return await eventually(lambda: _ended(http, f"/missions/{sent.json()['mission_id']}"), within_s=600)


async def _all_there(http: httpx.AsyncClient) -> bool:
    robots = (await http.get("/fleet")).json()["robots"]
    objects = (await http.get("/objects")).json()["objects"]
    ready = (await http.get("/readyz")).status_code == 200
    return ready and sum(r["online"] for r in robots) == len(YARD.robots) and len(objects) == len(YARD.things)


async def _ended(http: httpx.AsyncClient, address: str) -> dict[str, Any]:
    mission = (await http.get(address)).json()
    return mission if mission["state"] in ("succeeded", "failed", "rejected", "cancelled") else {}
