"""The planner as a process: `python -m muster_planner`, with a model behind an Ollama server."""

import asyncio
import threading
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager
from typing import Any

import httpx
import pytest
from muster_bus.testing import Process, RouterProcess, eventually, free_port, running_bus, service_process
from muster_planner.published import published_form
from muster_planner.testing import DRIVE, Missions, missions_side, show_objects, standing_robots
from muster_planner.testing_servers import ModelServer, model_server, says
from muster_schemas.mission import MissionStatus
from starlette.responses import Response

PLAN = published_form(DRIVE)


@pytest.fixture
def server() -> Generator[ModelServer]:
    """Provide an Ollama server."""
    with model_server() as running:
        yield running


@asynccontextmanager
async def the_site(router: RouterProcess) -> AsyncGenerator[Missions]:
    """Run everything of a site but the planner."""
    async with running_bus(router) as bus, missions_side(bus) as missions, standing_robots(bus):
        show_objects(bus)
        yield missions


def environment(server: ModelServer, **more: str) -> dict[str, str]:
    """Return a planner's environment."""
    return {"MUSTER_PLANNER": "ollama:llama3.1", "OLLAMA_HOST": server.url, "MUSTER_PORT": "0", **more}


async def client(process: Process) -> httpx.AsyncClient:
    """Return a client for a planner that is up."""
    port = (await process.until_logged("listening"))["port"]
    return httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=120)


async def test_an_accepted_instruction_survives_kill_9(router: RouterProcess, server: ModelServer) -> None:
    """Killed while the model thinks, the next planner finds the mission and plans it; it is planned once."""
    thinking, go_on = threading.Event(), threading.Event()

    async def think(_: dict[str, Any]) -> Response:
        thinking.set()
        await asyncio.to_thread(go_on.wait, 600)
        return says(PLAN)

    server.answers = [think, says(PLAN)]
    async with the_site(router) as missions:
        async with service_process("muster_planner", router, environment(server)) as first:
            async with await client(first) as http:
                answer = await http.post("/instructions", json={"text": "go to the soil"})
                assert answer.status_code == 202
            mission_id = answer.json()["mission_id"]
            await eventually(thinking.is_set)
            assert missions.state(mission_id) is MissionStatus.PLANNING
            await first.kill()
        async with service_process("muster_planner", router, environment(server)):
            await eventually(lambda: missions.state(mission_id) is MissionStatus.RUNNING)
        go_on.set()
        assert missions.views[mission_id].mission.revision == 2
    assert missions.views[mission_id].plan == DRIVE


async def test_it_stops_when_asked_also_with_listeners(router: RouterProcess, server: ModelServer) -> None:
    """SIGTERM ends it with 0 while an event stream is open and a model call is under way."""
    thinking, go_on = threading.Event(), threading.Event()

    async def think(_: dict[str, Any]) -> Response:
        thinking.set()
        await asyncio.to_thread(go_on.wait, 600)
        return says(PLAN)

    server.answers = [think]
    async with the_site(router), service_process("muster_planner", router, environment(server)) as process:
        async with await client(process) as http, http.stream("GET", "/events"):
            assert (await http.post("/instructions", json={"text": "go"})).status_code == 202
            await eventually(thinking.is_set)
            code = await process.terminate()
        go_on.set()
    assert code == 0, process.output


async def test_it_waits_for_a_scheduler(router: RouterProcess, server: ModelServer) -> None:
    """Alive but not ready, and an instruction is told to come back."""
    async with (
        service_process("muster_planner", router, environment(server)) as process,
        await client(process) as http,
    ):
        assert (await http.get("/healthz")).status_code == 200
        ready = await http.get("/readyz")
        assert (ready.status_code, ready.json()["code"]) == (503, "no_scheduler")
        sent = await http.post("/instructions", json={"text": "go"})
        assert (sent.status_code, sent.json()["code"]) == (503, "scheduler_silent")
        async with the_site(router):
            await eventually(lambda: _is_ready(http))


async def test_a_missing_model_server_is_told_to_the_operator(router: RouterProcess, server: ModelServer) -> None:
    """The mission is rejected with what to do, and the planner stays up."""
    nowhere = {"OLLAMA_HOST": f"http://127.0.0.1:{free_port()}"}
    async with (
        the_site(router) as missions,
        service_process("muster_planner", router, {**environment(server), **nowhere}) as process,
        await client(process) as http,
    ):
        mission_id = (await http.post("/instructions", json={"text": "go"})).json()["mission_id"]
        await eventually(lambda: missions.state(mission_id) is MissionStatus.REJECTED)
        dry = await http.post("/instructions", json={"text": "go", "dry_run": True})
    reason = missions.views[mission_id].mission.reasons[0]
    assert reason.code == "model_server_missing"
    assert "ollama serve" in reason.message
    assert (dry.status_code, dry.json()["code"]) == (503, "model_server_missing")


@pytest.mark.parametrize(
    ("wrong", "says_what"),
    [
        ({"MUSTER_PLANNER": "gpt-9"}, "MUSTER_PLANNER"),
        ({"MUSTER_PLANNER": "anthropic:some-model", "ANTHROPIC_API_KEY": ""}, "set ANTHROPIC_API_KEY"),
        ({"MUSTER_PLANNER": "openai:gpt-4o", "OPENAI_API_KEY": "", "OPENAI_BASE_URL": ""}, "set OPENAI_API_KEY"),
        ({"MUSTER_PORT": "99999"}, "MUSTER_PORT"),
        ({"MUSTER_PORT": "http"}, "MUSTER_PORT"),
        ({"MUSTER_PLAN_TIME_S": "-1"}, "MUSTER_PLAN_TIME_S"),
        ({"MUSTER_TOKEN": " "}, "MUSTER_TOKEN"),
        ({"MUSTER_HOST": "203.0.113.7", "MUSTER_TOKEN": "t"}, "cannot listen"),
    ],
)
async def test_bad_settings_are_refused(shared_router: RouterProcess, wrong: dict[str, str], says_what: str) -> None:
    """Exit code 78, and one line that says which."""
    process = Process("muster_planner", {**shared_router.environment, "MUSTER_PORT": "0", **wrong})
    try:
        assert await process.ended() == 78
        assert says_what in process.output
        assert "Traceback" not in process.output
    finally:
        process.dispose()


async def _is_ready(http: httpx.AsyncClient) -> bool:
    return (await http.get("/readyz")).status_code == 200
