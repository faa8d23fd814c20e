"""A slow reader harms itself only: streams skip to the newest, heartbeats of others come through."""

import asyncio

from muster_bus import Bus
from muster_bus.testing import RouterProcess, eventually, running_bus
from muster_schemas.channels import KEYWORDS, ROBOT_STATE
from muster_schemas.examples import EXAMPLES
from muster_schemas.robot import RobotState
from muster_schemas.world import Keywords


def send(bus: Bus, robot_id: str, seq: int) -> None:
    """Publish a robot's state."""
    state = RobotState.model_validate(
        {**EXAMPLES["robot_state"].message.model_dump(), "robot_id": robot_id, "seq": seq}
    )
    bus.publish(ROBOT_STATE, state, robot_id=robot_id)


async def test_a_slow_reader_of_a_stream_gets_the_newest_of_each_key(shared_router: RouterProcess, site: str) -> None:
    """While it was busy many came; it gets one of each robot, the newest."""
    robots = ("robot_a", "robot_b")
    async with (
        running_bus(shared_router, site) as sender,
        running_bus(shared_router, site) as reader,
        reader.subscribe(ROBOT_STATE) as slow,
        reader.subscribe(ROBOT_STATE) as quick,
    ):
        newest: dict[str, int] = {}

        async def note() -> None:
            async for received in quick:
                assert received.message is not None
                newest[received.message.robot_id] = received.message.seq

        noting = asyncio.create_task(note())
        last = 0

        def arrived() -> bool:
            nonlocal last
            if newest == dict.fromkeys(robots, last):
                return True
            for _ in range(300):  # again and again, because a stream may drop on its way
                last += 1
                for robot_id in robots:
                    send(sender, robot_id, last)
            return False

        await eventually(arrived)
        noting.cancel()
        taken: dict[str, int] = {}
        reads = 0
        while taken != dict.fromkeys(robots, last):
            received = await asyncio.wait_for(anext(slow), 120)
            assert received.message is not None
            taken[received.message.robot_id] = received.message.seq
            reads += 1
    # One each; one more each if the last message was on its way from one subscription to the other.
    assert reads <= 2 * len(robots)


async def test_a_reader_that_does_not_read_holds_nobody_up(shared_router: RouterProcess, site: str) -> None:
    """One subscription that is never read takes nothing from another of the same process, nor stops the sender."""
    async with (
        running_bus(shared_router, site) as sender,
        running_bus(shared_router, site) as reader,
        reader.subscribe(KEYWORDS),
        reader.subscribe(KEYWORDS) as read,
    ):
        many = 3000

        async def send_all() -> None:
            for i in range(many):
                sender.publish(KEYWORDS, Keywords(keywords=(str(i),), asked_by="a"))
                if i % 50 == 0:
                    await asyncio.sleep(0)

        sending = asyncio.create_task(send_all())
        got = [await asyncio.wait_for(anext(read), 120) for _ in range(many)]
        await sending
    assert [r.message.keywords[0] for r in got if r.message] == [str(i) for i in range(many)]
