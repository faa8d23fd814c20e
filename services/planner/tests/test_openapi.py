# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
# (schemathesis leaves the parameters of its generic types open)
"""The API is what its OpenAPI description says, for whatever is sent: schemathesis makes up the requests."""

import asyncio
import threading
from collections.abc import Generator
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from muster_bus.testing import RouterProcess
from muster_planner.testing import DRIVE, FunctionModel, Planner, running_planner
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)


class PlannerThread:
    """A planner that runs in a thread, for requests made by synchronous code."""

    def __init__(self, router: RouterProcess) -> None:
        self._router = router
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._up = threading.Event()
        self.url = ""
        self._thread = threading.Thread(target=lambda: self._loop.run_until_complete(self._run()))

    async def _run(self) -> None:
        async with running_planner(self._router, FunctionModel(lambda _: DRIVE)) as planner:
            await _make_missions(planner)
            self.url = str(planner.http.base_url)
            self._up.set()
            await self._stop.wait()

    def __enter__(self) -> "PlannerThread":
        self._thread.start()
        assert self._up.wait(60)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()
        self._loop.close()


async def _make_missions(planner: Planner) -> None:
    """Have missions that ids in the requests can hit."""
    for mission_id in ("a", "0", "m-1"):
        planner.missions.put(mission_id, "go", approval="ask")


@pytest.fixture(scope="module")
def url(shared_router: RouterProcess) -> Generator[str]:
    """Provide the address of a running planner."""
    with PlannerThread(shared_router) as running:
        yield running.url


def test_every_call_keeps_to_its_description(url: str) -> None:
    """Never a 5xx; statuses, content types and bodies are those that are described."""
    called: list[str] = []
    found: list[Any] = list(schemathesis.openapi.from_url(f"{url}/openapi.json").get_all_operations())
    for operation in (result.ok() for result in found):
        if operation.path != "/events":  # the stream does not end
            _call(operation)
            called.append(operation.path)
    assert len(called) >= 14


def _call(operation: Any) -> None:
    """Call one operation with made-up requests, good and bad."""

    @given(case=st.one_of(*(operation.as_strategy(generation_mode=mode) for mode in GenerationMode)))
    @settings(
        max_examples=20,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
    )
    def call(case: Any) -> None:
        case.call_and_validate(
            checks=[not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance]
        )

    call()
