"""Who may use the REST API."""

import pytest
from muster_bus.testing import Process, RouterProcess
from muster_planner.settings import PlannerSettings, is_loopback
from muster_planner.testing import DRIVE, FunctionModel, running_planner
from pydantic import SecretStr, ValidationError

CALLS = [
    ("POST", "/instructions"),
    ("GET", "/missions"),
    ("GET", "/missions/m-1"),
    ("POST", "/missions/m-1/approve"),
    ("POST", "/missions/m-1/cancel"),
    ("PUT", "/missions/m-1/plan"),
    ("GET", "/fleet"),
    ("GET", "/objects"),
    ("GET", "/areas"),
    ("GET", "/events"),
    ("GET", "/metrics"),
    ("GET", "/nothing"),
]


async def test_with_a_token_every_call_needs_it(shared_router: RouterProcess) -> None:
    """None, a wrong one, or one that is nearly right: 401; on loopback too, if it is set."""
    token = SecretStr("correct-horse")
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE), token=token) as planner:
        wrong = ["", "Bearer", "Bearer wrong", "Bearer correct-horse-", "Basic correct-horse", "Bearer \xfc"]
        for method, path in CALLS:
            for header in wrong:
                headers = [(b"Authorization", header.encode("latin-1"))]
                answer = await planner.http.request(method, path, headers=headers)
                assert answer.status_code == 401, (method, path, header)
                assert answer.headers["www-authenticate"] == "Bearer"
                assert answer.json()["code"] == "unauthorized"
        assert (await planner.http.get("/fleet")).status_code == 200


async def test_probes_and_the_description_are_open(shared_router: RouterProcess) -> None:
    """What starts and watches services has no token."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE), token=SecretStr("t")) as planner:
        for path in ("/healthz", "/readyz", "/docs", "/openapi.json"):
            assert (await planner.http.get(path, headers={"Authorization": ""})).status_code == 200, path


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Host": "evil.example"},
        {"Host": "evil.example:8000"},
        {"Host": "[::1"},
    ],
)
async def test_other_sites_pages_are_kept_out(shared_router: RouterProcess, headers: dict[str, str]) -> None:
    """A page of another site in an operator's browser must not command robots, nor through a name pointed at us."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        answer = await planner.http.post("/missions/m-1/cancel", headers=headers)
    assert answer.status_code == 403


async def test_a_form_of_another_page_is_no_instruction(shared_router: RouterProcess) -> None:
    """A body that is not declared as JSON is not read as JSON."""
    async with running_planner(shared_router, FunctionModel(lambda _: DRIVE)) as planner:
        headers = {"Content-Type": "text/plain"}
        answer = await planner.http.post("/instructions", content=b'{"text": "go"}', headers=headers)
        assert answer.status_code == 422
        assert planner.missions.views == {}


@pytest.mark.parametrize("host", ["10.0.0.1", "::", "192.168.1.5", "planner.example"])
def test_beyond_loopback_a_token_is_required(host: str) -> None:
    """The settings are refused without one."""
    with pytest.raises(ValidationError, match="must be set"):
        PlannerSettings(host=host)
    assert PlannerSettings(host=host, token=SecretStr("t")).host == host


@pytest.mark.parametrize("token", ["", "   ", "schlüssel"])
def test_a_token_that_no_header_can_carry_is_refused(token: str) -> None:
    """Empty, blank or not ASCII."""
    with pytest.raises(ValidationError, match="openssl"):
        PlannerSettings(token=SecretStr(token))


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("127.1.2.3", True), ("::1", True), ("localhost", True), ("10.0.0.1", False), ("", False)],
)
def test_loopback_is_what_only_this_machine_reaches(host: str, loopback: bool) -> None:
    """Names other than localhost do not count, whatever they resolve to."""
    assert is_loopback(host) is loopback


async def test_the_process_refuses_to_start_without_a_token(shared_router: RouterProcess) -> None:
    """Exit code 78 and a line that says what to set."""
    process = Process("muster_planner", {**shared_router.environment, "MUSTER_HOST": "10.0.0.1", "MUSTER_PORT": "0"})
    try:
        assert await process.ended() == 78
        assert "MUSTER_TOKEN" in process.output
    finally:
        process.dispose()
