"""Keeping a process's view of its site up to date from the bus."""

import asyncio

from muster_bus import Bus
from muster_schemas.channels import AREAS, OBJECT, ROBOT_CARD, ROBOT_STATE

from .surroundings import SiteView


async def follow_site(bus: Bus, view: SiteView) -> None:
    """Fill the view with the site's objects, rules, cards and robot states until cancelled."""
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(_objects(bus, view))
        tasks.create_task(_rules(bus, view))
        tasks.create_task(_cards(bus, view))
        tasks.create_task(_states(bus, view))


async def _objects(bus: Bus, view: SiteView) -> None:
    async with bus.subscribe(OBJECT) as messages:
        async for received in messages:
            name = received.ids["object_name"]
            if received.message is None:
                view.objects.pop(name, None)
            else:
                view.objects[name] = received.message


async def _rules(bus: Bus, view: SiteView) -> None:
    async with bus.subscribe(AREAS) as messages:
        async for received in messages:
            # the scheduler's rules outlive it, so rules that vanish from the bus still hold here
            if received.message is not None and received.message.revision >= view.rules.revision:
                view.rules = received.message


async def _cards(bus: Bus, view: SiteView) -> None:
    async with bus.subscribe(ROBOT_CARD) as messages:
        async for received in messages:
            if received.message is not None:
                view.cards[received.ids["robot_id"]] = received.message


async def _states(bus: Bus, view: SiteView) -> None:
    async with bus.subscribe(ROBOT_STATE) as messages:
        async for received in messages:
            if received.message is not None:
                view.states[received.ids["robot_id"]] = received.message
