"""The way from Zenoh's threads into the loop."""

import asyncio
import threading

import pytest
from muster_bus.inbox import Inbox, InboxClosedError, call_in


async def take_all(inbox: Inbox[int]) -> list[int]:
    """Close it and return what is in it."""
    inbox.close()
    items: list[int] = []
    while True:
        try:
            items.append(await inbox.get())
        except InboxClosedError:
            return items


async def test_items_come_in_order() -> None:
    """Nothing is lost or turned round."""
    inbox: Inbox[int] = Inbox()
    for i in range(100):
        inbox.put("key", i)
    assert await take_all(inbox) == list(range(100))


async def test_the_newest_of_each_key_is_kept() -> None:
    """A slow reader of a stream gets each key once, with its newest item."""
    inbox: Inbox[int] = Inbox(newest_only=True)
    for i in range(100):
        inbox.put(str(i % 3), i)
    assert await take_all(inbox) == [99, 97, 98]


async def test_a_full_one_turns_new_items_away_and_counts_them() -> None:
    """What was accepted stays; what was not is known."""
    inbox: Inbox[int] = Inbox(limit=10)
    for i in range(15):
        inbox.put("key", i)
    assert inbox.overflowed == 5
    assert await take_all(inbox) == list(range(10))


async def test_a_full_one_by_key_forgets_only_what_is_replaced() -> None:
    """Of states the last one of every key survives, however many there are."""
    inbox: Inbox[int] = Inbox(by_key=True, limit=10)
    for i in range(1000):
        inbox.put(str(i % 50), i)
    assert inbox.overflowed == 0
    items = await take_all(inbox)
    assert set(range(950, 1000)) <= set(items)
    assert len(items) < 200


async def test_a_waiting_reader_is_woken_from_a_thread() -> None:
    """A reader that waits gets what another thread puts, thousands of times."""
    inbox: Inbox[int] = Inbox()
    many = 5000

    def put() -> None:
        for i in range(many):
            inbox.put("key", i)

    thread = threading.Thread(target=put)
    reading = asyncio.gather(*[inbox.get()])
    thread.start()
    items = list(await reading)
    while len(items) < many:
        items.append(await asyncio.wait_for(inbox.get(), 120))
    thread.join()
    assert items == list(range(many))


async def test_a_flood_leaves_other_tasks_their_turn() -> None:
    """Reading what is there already does not keep the loop from everything else."""
    inbox: Inbox[int] = Inbox()
    for i in range(1000):
        inbox.put("key", i)
    turns = 0

    async def other() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    task = asyncio.create_task(other())
    await take_all(inbox)
    task.cancel()
    assert turns >= 10


async def test_cancelling_a_reader_loses_nothing() -> None:
    """A reader that gave up waiting has taken nothing with it."""
    inbox: Inbox[int] = Inbox()
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(inbox.get(), 0.01)
    inbox.put("key", 1)
    assert await inbox.get() == 1


async def test_a_closed_loop_is_not_called() -> None:
    """A callback that comes after the end of the loop is dropped without an error."""
    loop = asyncio.new_event_loop()
    loop.close()
    called: list[int] = []
    call_in(loop, lambda: called.append(1))
    assert called == []
