"""What comes over HTTP and is wrong: never a 5xx, always problem details that tell what to do, and nothing is made."""

import asyncio
import json
from collections.abc import AsyncIterator

import pytest
from muster_bus.testing import RouterProcess
from muster_planner.testing import DRIVE, FunctionModel, running_planner

BODIES: dict[str, tuple[bytes, int, str]] = {
    "broken JSON": (b'{"text": "go"', 400, "broken_json"),
    "no JSON at all": (b"go to the soil", 400, "broken_json"),
    "not UTF-8": (b'{"text": "\xff\xfe"}', 400, "broken_json"),
    "deeply nested": (b"[" * 60_000, 400, "broken_json"),
    "an endless number": (b'{"text": "go", "priority": ' + b"9" * 5_000 + b"}", 400, "broken_json"),
    "a list": (b'["go"]', 422, "invalid_request"),
    "nothing": (b"", 422, "invalid_request"),
    "no text": (b"{}", 422, "invalid_request"),
    "a number for a text": (b'{"text": 5}', 422, "invalid_request"),
    "a text for a number": (b'{"text": "go", "priority": "5"}', 422, "invalid_request"),
    "a priority that is none": (b'{"text": "go", "priority": 10}', 422, "invalid_request"),
    "an approval that is none": (b'{"text": "go", "approval": "maybe"}', 422, "invalid_request"),
    "a mistyped field": (b'{"text": "go", "prioritty": 5}', 422, "invalid_request"),
    "an empty text": (b'{"text": ""}', 422, "invalid_request"),
    "only spaces": (b'{"text": "  \\n\\t "}', 422, "no_instruction"),
    "only control characters": (b'{"text": "\\u0000\\u0007\\u200b"}', 422, "no_instruction"),
    "half a character": (b'{"text": "\\ud800"}', 422, "invalid_request"),
    "half a character as a field": (b'{"text": "go", "\\ud800": 1}', 422, "invalid_request"),
    "3,000 characters": (json.dumps({"text": "dig " * 750}).encode(), 422, "no_instruction"),
    "30,000 characters": (json.dumps({"text": "dig " * 7_500}).encode(), 422, "invalid_request"),
    "a huge body": (json.dumps({"text": "dig " * 75_000}).encode(), 413, "too_large"),
}


async def test_bad_bodies_are_problems(shared_router: RouterProcess) -> None:
    """Each is refused with its status and code, and no mission comes of it."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        headers = {"Content-Type": "application/json"}
        found: dict[str, tuple[int, str]] = {}
        for name, (body, _, _) in BODIES.items():
            answer = await planner.http.post("/instructions", content=body, headers=headers)
            assert answer.headers["content-type"] == "application/problem+json", name
            problem = answer.json()
            assert problem["detail"], name
            assert problem["status"] == answer.status_code, name
            assert problem["title"], name
            found[name] = (answer.status_code, problem["code"])
        assert found == {name: expected for name, (_, *rest) in BODIES.items() for expected in [tuple(rest)]}
        assert planner.missions.views == {}


async def test_limits_are_said(shared_router: RouterProcess) -> None:
    """Whoever sends too much learns how much may be sent."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        long = await planner.http.post("/instructions", json={"text": "dig " * 750})
        large = await planner.http.post("/instructions", json={"text": "dig " * 75_000})
    assert "2000" in long.json()["detail"]
    assert "65536" in large.json()["detail"]


async def test_a_huge_body_in_pieces_is_refused_while_it_comes(shared_router: RouterProcess) -> None:
    """Without a length in its header a body is counted as it comes in."""

    async def pieces() -> AsyncIterator[bytes]:
        for _ in range(100):
            yield b" " * 10_000

    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        headers = {"Content-Type": "application/json"}
        answer = await planner.http.post("/instructions", content=pieces(), headers=headers)
    assert answer.status_code == 413


async def test_control_characters_are_taken_out_of_an_instruction(shared_router: RouterProcess) -> None:
    """The mission's text is in composed form, on one line, without invisible characters."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        mission_id = await planner.send("  dig\u0000 at\n the\u200b so\u0308il\t")
        assert planner.missions.views[mission_id].mission.text == "dig at the s\u00f6il"


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/missions/UPPER", 422),
        ("POST", "/missions/a%2Fb/cancel", 404),
        ("POST", "/missions/..%2f..%2fetc/cancel", 404),
        ("GET", "/missions/%00", 422),
        ("GET", "/missions/m-1%0a", 422),
        ("GET", "/missions?limit=0", 422),
        ("GET", "/missions?limit=many", 422),
        ("GET", "/missions?state=flying", 422),
        ("GET", "/nothing", 404),
        ("DELETE", "/missions/m-1", 405),
        ("GET", "/instructions", 405),
    ],
)
async def test_bad_addresses_are_problems(shared_router: RouterProcess, method: str, path: str, status: int) -> None:
    """Ids are checked before anything is asked of the bus; what does not exist is said so."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        answer = await planner.http.request(method, path)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"


async def test_a_bad_idempotency_key_is_refused(shared_router: RouterProcess) -> None:
    """Empty, with spaces, or too long."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        for key in ("", "two words", "k" * 129):
            answer = await planner.http.post("/instructions", json={"text": "go"}, headers={"Idempotency-Key": key})
            assert answer.status_code == 422, key
        assert planner.missions.views == {}


async def test_bad_plans_are_refused(shared_router: RouterProcess) -> None:
    """An edited plan must be of the plan's form."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        headers = {"Content-Type": "application/json"}
        for body in ("{}", '{"tasks": 5}', '{"tasks": [{"task": "a"}]}', json.dumps({"tasks": [{}] * 101})):
            answer = await planner.http.put("/missions/m-1/plan", content=body, headers=headers)
            assert answer.status_code == 422, body


async def test_a_silent_scheduler_is_503_with_retry_after(shared_router: RouterProcess) -> None:
    """Nobody knows whether it was done, so that is what the answer says."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        planner.missions.answers_after_s = 2.5  # a submit waits for 2 s
        answer = await planner.http.post("/missions/m-none/cancel")
        assert answer.status_code == 404  # it can answer this one at once
        sent = await planner.http.post("/instructions", json={"text": "go"})
    assert sent.status_code == 503
    assert int(sent.headers["retry-after"]) > 0
    assert sent.json()["code"] == "scheduler_silent"


async def test_a_full_queue_is_503_and_makes_nothing(shared_router: RouterProcess) -> None:
    """More instructions than may wait are told to come back, before a mission is made."""
    hold = asyncio.Event()

    async def wait_for_hold(_: object) -> str:
        await hold.wait()
        return "no"

    async with running_planner(shared_router, FunctionModel(wait_for_hold), plan_queue=2) as planner:
        for _ in range(2):
            await planner.send("go")
        for body in ({"text": "go"}, {"text": "go", "dry_run": True}):
            answer = await planner.http.post("/instructions", json=body)
            assert (answer.status_code, answer.json()["code"]) == (503, "busy")
            assert answer.headers["retry-after"]
        assert len(planner.missions.views) == 2
        assert (await planner.http.get("/readyz")).status_code == 503
        hold.set()
