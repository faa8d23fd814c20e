"""What remote models may cost a day, over restarts."""

import json
from pathlib import Path

import pytest
from muster_planner.adapters.remote import Chat, RemoteModel, Reply
from muster_planner.budget import DailyBudget
from muster_planner.drafting import draft_plan
from muster_planner.errors import (
    BudgetFileError,
    BudgetSpentError,
    ModelBusyError,
    ModelTimeoutError,
    PlanningError,
    ServerMissingError,
)
from muster_planner.published import published_form
from muster_planner.scenes import FileScene
from muster_planner.testing import DRIVE, YARD, FunctionModel

DAY_S = 86_400.0
SCENE = FileScene(YARD)


class Clock:
    """Seconds since 1970, as the test wants them."""

    def __init__(self, now: float = 100 * DAY_S) -> None:
        self.now = now

    def __call__(self) -> float:
        """Return them."""
        return self.now


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Provide where the budget is kept."""
    return tmp_path / "data" / "planner-budget.json"


def test_what_was_spent_survives_a_restart(file: Path) -> None:
    """Also what a call would have cost that its planner did not live to see the end of."""
    clock = Clock()
    budget = DailyBudget(file, 1000, clock)
    budget.hold(600).settle(100)
    budget.hold(500)
    assert DailyBudget(file, 1000, clock).left == 400
    with pytest.raises(BudgetSpentError, match="MUSTER_PLAN_TOKENS_PER_DAY"):
        DailyBudget(file, 1000, clock).hold(401)


def test_a_new_day_begins_anew_and_a_clock_that_goes_back_does_not(file: Path) -> None:
    """A call over midnight counts for the day on which it began."""
    clock = Clock()
    budget = DailyBudget(file, 1000, clock)
    late = budget.hold(900)
    clock.now += DAY_S
    assert budget.left == 1000
    budget.hold(300)
    late.settle(0)
    assert budget.left == 700
    clock.now -= 3 * DAY_S
    assert budget.left == 700
    assert DailyBudget(file, 1000, clock).left == 700


@pytest.mark.parametrize("content", [b"", b"{", b'{"day": 1}', b'{"day": -1, "tokens": 0}', b"\xff"])
def test_a_file_that_cannot_be_read_spends_nothing(file: Path, content: bytes) -> None:
    """The error says what to do; once it is done, planning goes on."""
    file.parent.mkdir()
    file.write_bytes(content)
    budget = DailyBudget(file, 1000)
    with pytest.raises(BudgetFileError, match="Delete the file"):
        budget.hold(1)
    file.unlink()
    budget.hold(1)


def test_what_cannot_be_written_down_is_not_spent(tmp_path: Path) -> None:
    """Without a place for its file there is no budget."""
    (tmp_path / "data").write_text("no folder")
    with pytest.raises(BudgetFileError):
        DailyBudget(tmp_path / "data" / "budget.json", 1000).hold(1)


class Server:
    """A server that answers with a plan, or fails."""

    name = "some-model"
    strict = False

    def __init__(self, *failures: PlanningError | TimeoutError) -> None:
        self.failures = list(failures)
        self.calls = 0

    async def ask(self, chat: Chat, form: dict[str, object] | None, *, max_tokens: int) -> Reply:
        """Answer."""
        del chat, form, max_tokens
        self.calls += 1
        if self.failures:
            raise self.failures.pop(0)
        return Reply(DRIVE_TEXT, tokens_in=700, tokens_out=300)


DRIVE_TEXT = json.dumps(published_form(DRIVE))


async def test_a_mission_is_rejected_once_the_day_is_used_up(file: Path) -> None:
    """With the reason, and without a call; the day before it was planned."""
    clock = Clock()
    server = Server()
    model = RemoteModel(server, DailyBudget(file, 9_500, clock))
    assert (await draft_plan("go", model, SCENE)).plan == DRIVE
    assert DailyBudget(file, 9_500, clock).left == 8_500
    poor = RemoteModel(server, DailyBudget(file, 2_000, clock))
    outcome = await draft_plan("go", poor, SCENE)
    assert [r.code for r in outcome.reasons] == ["token_budget_spent"]
    assert server.calls == 1


async def test_a_call_without_a_word_on_its_cost_has_cost_the_most(file: Path) -> None:
    """One that never reached its server has cost nothing."""
    clock = Clock()
    request = SCENE.now().request("go", None, timeout_s=60, max_tokens=500)
    budget = DailyBudget(file, 100_000, clock)
    for error in (ServerMissingError("gone"), ModelBusyError("busy")):
        with pytest.raises(type(error)):
            await RemoteModel(Server(error), budget).plan(request)
    assert budget.left == 100_000
    with pytest.raises(ModelTimeoutError):
        await RemoteModel(Server(TimeoutError()), budget).plan(request)
    assert budget.left < 99_000


@pytest.mark.parametrize("error", [ServerMissingError("gone"), ModelBusyError("busy", retry_after_s=0.01)])
async def test_a_server_is_asked_once_more_and_not_for_ever(error: PlanningError) -> None:
    """Two calls, then the mission says what to do."""
    calls = 0

    def fail(_: object) -> str:
        nonlocal calls
        calls += 1
        raise error

    outcome = await draft_plan("go", FunctionModel(fail), SCENE)
    assert calls == 2
    assert [r.message for r in outcome.reasons] == [str(error)]


async def test_a_pause_longer_than_the_missions_time_is_not_waited_for() -> None:
    """The operator is told at once."""
    calls = 0

    def fail(_: object) -> str:
        nonlocal calls
        calls += 1
        raise ModelBusyError("busy", retry_after_s=3_600)

    outcome = await draft_plan("go", FunctionModel(fail), SCENE)
    assert (calls, [r.code for r in outcome.reasons]) == (1, ["model_busy"])
