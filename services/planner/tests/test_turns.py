"""Who gets the model next."""

import asyncio

from muster_planner.turns import Turns


async def test_higher_priority_goes_first_then_the_order_of_arrival() -> None:
    """And only one holds the turn at a time."""
    turns, order = Turns(), list[str]()
    async with turns.take(0):
        waiting = [asyncio.create_task(_take(turns, p, n, order)) for n, p in (("a", 5), ("b", 5), ("c", 9), ("d", 0))]
        await asyncio.sleep(0)
        assert order == []
    await asyncio.gather(*waiting)
    assert order == ["c", "a", "b", "d"]


async def test_whoever_gives_up_waiting_does_not_hold_up_the_others() -> None:
    """Neither while waiting nor at the moment of being given the turn."""
    turns, order = Turns(), list[str]()
    async with turns.take(5):
        waiting = [asyncio.create_task(_take(turns, 5, n, order)) for n in "abc"]
        await asyncio.sleep(0)
        waiting[1].cancel()
        await asyncio.sleep(0)
    waiting[0].cancel()  # has been given the turn, has not run yet
    await asyncio.gather(*waiting, return_exceptions=True)
    assert order == ["c"]
    async with asyncio.timeout(60), turns.take(5):
        pass


async def test_the_turn_is_given_back_after_an_error() -> None:
    """The next one gets it."""
    turns = Turns()
    try:
        async with turns.take(5):
            raise ValueError
    except ValueError:
        pass
    async with asyncio.timeout(60), turns.take(5):
        pass


async def _take(turns: Turns, priority: int, name: str, order: list[str]) -> None:
    async with turns.take(priority):
        order.append(name)
        await asyncio.sleep(0)
