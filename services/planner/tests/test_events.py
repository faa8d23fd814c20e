"""Handing events to listeners."""

import pytest
from muster_planner.events import MAX_LISTENERS, Event, Hub, TooManyListenersError


async def test_each_listener_gets_each_event_in_order() -> None:
    """From the moment that it listens."""
    hub = Hub()
    hub.send(Event("mission", "before"))
    with hub.listen() as one, hub.listen() as two:
        for n in range(3):
            hub.send(Event("mission", str(n)))
        hub.close()
        assert [e.data async for e in one.read()] == [e.data async for e in two.read()] == ["0", "1", "2"]


async def test_a_listener_that_is_too_slow_is_ended() -> None:
    """It comes again and reads anew; what waits for it is bounded, and others go on."""
    hub = Hub()
    with hub.listen() as slow:
        for n in range(5_000):
            hub.send(Event("robot", str(n)))
        with hub.listen() as fresh:
            hub.send(Event("robot", "last"))
            hub.close()
            assert [e.data async for e in fresh.read()] == ["last"]
        assert len([e async for e in slow.read()]) == 2_000


async def test_listeners_are_bounded() -> None:
    """One more than may be is told so, until another has gone."""
    hub = Hub()
    contexts = [hub.listen() for _ in range(MAX_LISTENERS)]
    for context in contexts:
        context.__enter__()
    with pytest.raises(TooManyListenersError), hub.listen():
        pass
    contexts[0].__exit__(None, None, None)
    with hub.listen():
        assert hub.listeners == MAX_LISTENERS


async def test_after_the_end_listening_ends_at_once() -> None:
    """A request that comes while the service stops does not hold it up."""
    hub = Hub()
    hub.close()
    with hub.listen() as late:
        assert [e async for e in late.read()] == []
