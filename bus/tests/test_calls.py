"""Request and reply: what an asker can and cannot know."""

import asyncio
import signal

import pytest
from muster_bus import NoReplyError, Refusal, RefusedError, TooBigError
from muster_bus.testing import RouterProcess, eventually, running_bus, service_process
from muster_schemas.channels import MISSIONS
from muster_schemas.examples import EXAMPLES
from muster_schemas.mission import MissionView, Reason
from muster_schemas.rpc import ErrorCode, ErrorReply, MissionsQuery, MissionsReply

EMPTY = MissionsReply(missions=())


async def test_a_refusal_reaches_the_asker_with_its_reasons(shared_router: RouterProcess, site: str) -> None:
    """What a handler raises as a refusal, the asker gets as an error, whole."""
    error = ErrorReply(
        code=ErrorCode.CONFLICT, message="It has ended.", reasons=(Reason(code="ended", message="It has ended."),)
    )

    async def refuse(_request: MissionsQuery) -> MissionsReply:
        raise Refusal(error)

    async with running_bus(shared_router, site) as bus, bus.serve(MISSIONS, refuse):
        with pytest.raises(RefusedError, match="It has ended") as caught:
            await bus.ask(MISSIONS, MissionsQuery(), timeout_s=60)
    assert caught.value.error == error


async def test_a_handler_that_breaks_answers_so_and_serves_on(shared_router: RouterProcess, site: str) -> None:
    """An unexpected error is answered as internal, without its text, and the next request is served."""

    async def handle(request: MissionsQuery) -> MissionsReply:
        if request.limit == 1:
            raise RuntimeError("secret detail")
        return EMPTY

    async with running_bus(shared_router, site) as bus, bus.serve(MISSIONS, handle):
        with pytest.raises(RefusedError) as caught:
            await bus.ask(MISSIONS, MissionsQuery(limit=1), timeout_s=60)
        assert caught.value.error.code is ErrorCode.INTERNAL
        assert "secret" not in caught.value.error.message
        assert await bus.ask(MISSIONS, MissionsQuery(), timeout_s=60) == EMPTY


async def test_nobody_there_is_no_reply(shared_router: RouterProcess, site: str) -> None:
    """Without a server the asker learns soon that nobody answered, and who should have."""
    async with running_bus(shared_router, site) as bus:
        with pytest.raises(NoReplyError, match="is the scheduler running"):
            await bus.ask(MISSIONS, MissionsQuery(), timeout_s=60)


async def test_a_server_that_is_too_slow_is_no_reply(shared_router: RouterProcess, site: str) -> None:
    """After its time limit the asker gives up, though the request still runs."""
    release, finished = asyncio.Event(), asyncio.Event()

    async def slow(_request: MissionsQuery) -> MissionsReply:
        await release.wait()
        finished.set()
        return EMPTY

    async with (
        running_bus(shared_router, site) as server,
        running_bus(shared_router, site) as asker,
        server.serve(MISSIONS, slow),
    ):
        with pytest.raises(NoReplyError, match=r"within 0\.2 s"):
            await asker.ask(MISSIONS, MissionsQuery(), timeout_s=0.2)
        release.set()
        await asyncio.wait_for(finished.wait(), 120)


async def test_requests_run_beside_each_other(shared_router: RouterProcess, site: str) -> None:
    """A slow request does not hold up the others."""
    release = asyncio.Event()

    async def handle(request: MissionsQuery) -> MissionsReply:
        if request.limit == 1:
            await release.wait()
        return EMPTY

    async with running_bus(shared_router, site) as bus, bus.serve(MISSIONS, handle):
        slow = asyncio.create_task(bus.ask(MISSIONS, MissionsQuery(limit=1), timeout_s=60))
        assert await bus.ask(MISSIONS, MissionsQuery(), timeout_s=60) == EMPTY
        assert not slow.done()
        release.set()
        assert await slow == EMPTY


async def test_of_two_servers_one_runs_a_request(shared_router: RouterProcess, site: str) -> None:
    """A second server on the channel, such as one that hung for a while, never doubles a command."""
    runs = 0

    async def handle(_request: MissionsQuery) -> MissionsReply:
        nonlocal runs
        runs += 1
        return EMPTY

    async with (
        running_bus(shared_router, site) as one,
        running_bus(shared_router, site) as two,
        running_bus(shared_router, site) as asker,
        one.serve(MISSIONS, handle),
        two.serve(MISSIONS, handle),
    ):
        for _ in range(20):
            await asker.ask(MISSIONS, MissionsQuery(), timeout_s=60)
    assert runs == 20


async def test_a_reply_that_is_too_large_is_refused(shared_router: RouterProcess, site: str) -> None:
    """The asker is told to ask for less instead of getting a piece or nothing."""
    example = EXAMPLES["mission_state"].message.model_dump()
    mission = MissionView.model_validate({"mission": {**example, "text": "x" * 2000}})

    async def handle(_request: MissionsQuery) -> MissionsReply:
        return MissionsReply(missions=(mission,) * 5000)

    async with running_bus(shared_router, site) as bus, bus.serve(MISSIONS, handle):
        with pytest.raises(RefusedError, match="ask for less"):
            await bus.ask(MISSIONS, MissionsQuery(), timeout_s=60)


async def test_a_request_that_is_too_large_is_not_sent(shared_router: RouterProcess, site: str) -> None:
    """The asker's own mistake is told to it at once."""
    states = MissionsQuery.model_construct(mission_id="x" * (9 * 2**20), states=(), limit=1)
    async with running_bus(shared_router, site) as bus:
        with pytest.raises(TooBigError):
            await bus.ask(MISSIONS, states)


async def test_leaving_lets_running_requests_finish(shared_router: RouterProcess, site: str) -> None:
    """A server that stops still answers what it has begun."""
    begun, release = asyncio.Event(), asyncio.Event()

    async def slow(_request: MissionsQuery) -> MissionsReply:
        begun.set()
        await release.wait()
        return EMPTY

    async with running_bus(shared_router, site) as server, running_bus(shared_router, site) as asker:
        async with server.serve(MISSIONS, slow):
            asking = asyncio.create_task(asker.ask(MISSIONS, MissionsQuery(), timeout_s=60))
            await asyncio.wait_for(begun.wait(), 120)
            asyncio.get_running_loop().call_soon(release.set)
        assert await asking == EMPTY


async def test_a_server_that_dies_is_no_reply_at_once(shared_router: RouterProcess, programs: dict[str, str]) -> None:
    """Killed in the middle of a request, it leaves the asker without an answer, but not waiting for the limit."""
    async with (
        service_process("lamp", shared_router, {**programs, "MUSTER_TROUBLE": "slow"}) as lamp,
        running_bus(shared_router) as bus,
    ):
        asking = asyncio.create_task(bus.ask(MISSIONS, MissionsQuery(), timeout_s=600))
        await lamp.until_logged("asked")
        lamp.signal(signal.SIGKILL)
        with pytest.raises(NoReplyError):
            await asyncio.wait_for(asking, 120)
        await eventually(lambda: lamp.exit_code is not None)
