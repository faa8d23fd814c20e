"""Bad input at every edge of a running site: a clear refusal, nothing moves or ends, and good input still works."""

# pyright: reportUnknownMemberType=false
# (Zenoh's stubs leave return types out.)

import asyncio
import json
import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
import zenoh
from muster_bus import RefusedError, open_bus
from muster_bus.testing import SITE_FILE, Process
from muster_schemas.channels import CHANNELS, SUBMIT, Kind
from muster_schemas.examples import EXAMPLES
from muster_schemas.plan import Plan
from muster_schemas.rpc import SubmitMission

from tests.running_site import RunningSite, describe, plan_of_case, running_site, submit, succeeded, until_ended

pytestmark = [pytest.mark.end_to_end, pytest.mark.timeout(1800)]
ENDS_WITHIN_S = 400.0


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSite]:
    """Run the default site; whatever the tests send, no process of it may end."""
    with running_site(tmp_path_factory.mktemp("site"), speed=8) as running:
        yield running
        assert running.problems() == []


def task(name: str, skill: str = "excavator_digging", **fields: Any) -> dict[str, Any]:
    """Return one task of a plan."""
    return {"task": name, "instruction_function": {"name": skill, "robot_ids": ["robot_excavator_01"], **fields}}


BAD_PLANS: dict[str, tuple[list[dict[str, Any]], str]] = {
    "no task": ([], "empty_plan"),
    "an unknown object": ([task("a", object_keywords=["volcano1"])], "unknown_object"),
    "an unknown robot": ([task("a", robot_ids=["robot_excavator_09"])], "unknown_robot"),
    "an unknown skill": ([task("a", "fly_to_the_moon")], "unknown_skill"),
    "a robot of the wrong type": ([task("a", robot_ids=["robot_dump_truck_01"])], "wrong_type"),
    "a circle": ([task("a", dependencies=["b"]), task("b", dependencies=["a"])], "cycle"),
    "a task that waits for itself": ([task("a", dependencies=["a"])], "cycle"),
    "an unknown dependency": ([task("a", dependencies=["z"])], "unknown_dependency"),
    "two tasks of one name": ([task("a"), task("a")], "repeated_name"),
    "a key in place of an object": ([task("a", object_keywords=["../**"])], "invalid_object"),
}


@pytest.mark.parametrize("what", BAD_PLANS)
async def test_a_bad_plan_is_refused_with_its_reason(site: RunningSite, what: str) -> None:
    """The scheduler says why, makes no mission, and no robot moves."""
    tasks, code = BAD_PLANS[what]
    async with open_bus("yard", [site.endpoint]) as bus:
        request = SubmitMission(text=f"bad: {what}", plan=Plan.model_validate({"tasks": tasks}))
        with pytest.raises(RefusedError) as refused:
            await bus.ask(SUBMIT, request, timeout_s=60)
    assert code in {r.code for r in refused.value.error.reasons}
    assert all(r.message for r in refused.value.error.reasons)


BAD_TEXTS = {
    "a robot that does not exist": "Excavator 9 digs at the soil pile.",
    "an object that does not exist": "Truck 1 drives to puddle 7.",
    "no instruction": "Thanks a lot, and have a nice weekend.",
}


@pytest.mark.parametrize("what", BAD_TEXTS)
async def test_an_instruction_that_cannot_be_done_is_rejected(site: RunningSite, what: str) -> None:
    """It gets an answer at once, then the mission is rejected with reasons a person understands; no robot moves."""
    async with httpx.AsyncClient(base_url=site.url, timeout=120) as client:
        answer = await client.post("/instructions", json={"text": BAD_TEXTS[what]})
        assert answer.status_code == 202, answer.text
        path = f"/missions/{answer.json()['mission_id']}"
        until = time.monotonic() + ENDS_WITHIN_S
        mission = (await client.get(path)).json()
        while mission["state"] == "planning" and time.monotonic() < until:
            await asyncio.sleep(0.2)
            mission = (await client.get(path)).json()
    assert mission["state"] == "rejected", mission
    assert mission["reasons"]
    assert site.history(mission["mission_id"]) == []


@pytest.mark.parametrize(
    ("body", "status"),
    [(b'{"text": ', 400), (b"{}", 422), (json.dumps({"text": "x" * 3000}).encode(), 422), (b'{"text": " "}', 422)],
    ids=["broken JSON", "no text", "3,000 characters", "only spaces"],
)
async def test_a_bad_request_is_a_problem_document(site: RunningSite, body: bytes, status: int) -> None:
    """It says what is wrong, and there is no more mission than before."""
    async with httpx.AsyncClient(base_url=site.url, timeout=120) as client:
        before = (await client.get("/missions")).json()["missions"]
        answer = await client.post("/instructions", content=body, headers={"Content-Type": "application/json"})
        after = (await client.get("/missions")).json()["missions"]
    assert answer.status_code == status
    assert answer.json()["detail"]
    assert [m["mission_id"] for m in after] == [m["mission_id"] for m in before]


RUBBISH = [b"", b"{", b"\xff\xfe", b"[" * 5_000, b'{"seq": 1e999}', b"null", b"[]"]


async def test_rubbish_on_every_key_changes_nothing(site: RunningSite) -> None:
    """After malformed messages on all channels each process still runs, and a mission still reaches its end."""
    config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [site.endpoint]}}))

    def throw() -> None:
        with zenoh.open(config) as stranger:
            for channel in CHANNELS:
                if channel.kind is Kind.LIVELINESS:
                    continue  # a token has no payload
                ids = EXAMPLES[channel.name].ids | {"robot_id": "robot_excavator_01", "object_name": "soil1"}
                key = channel.key(site="yard", **{field: ids[field] for field in channel.fields if field != "site"})
                for rubbish in RUBBISH:
                    if channel.kind is Kind.QUERY:
                        list(stranger.get(key, payload=rubbish, timeout=5.0))
                    else:
                        stranger.put(key, rubbish, encoding=zenoh.Encoding.APPLICATION_JSON)

    await asyncio.to_thread(throw)
    async with open_bus("yard", [site.endpoint]) as bus:
        view = await until_ended(bus, await submit(bus, "after rubbish", plan_of_case("A-L1-005")), ENDS_WITHIN_S)
    assert succeeded(view), describe(view)
    assert site.problems() == []


@pytest.mark.parametrize(
    ("module", "settings"),
    [
        ("muster_scheduler", {}),
        ("muster_robot_agent", {"MUSTER_ROBOT_ID": "robot_excavator_01"}),
        ("muster_sim", {}),
        ("muster_vision", {}),
        ("muster_planner", {"MUSTER_PORT": "0"}),
    ],
)
async def test_a_second_process_with_the_same_id_does_not_start(
    site: RunningSite, module: str, settings: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """It ends with a clear message, and the first one goes on."""
    common = {
        "MUSTER_SITE_FILE": str(SITE_FILE),
        "MUSTER_CONNECT": site.endpoint,
        "MUSTER_DATA_DIR": str(tmp_path_factory.mktemp("second")),
    }
    second = Process(module, common | settings)
    try:
        assert await second.ended(within_s=400) == 69
    finally:
        await asyncio.to_thread(second.dispose)
    assert "already" in second.output
    assert site.problems() == []
