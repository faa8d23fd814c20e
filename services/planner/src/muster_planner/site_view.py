"""The live site as the planner sees it over the bus: who is there, what the cameras see, what is forbidden."""

import asyncio
import json
import re
import time
from collections.abc import Callable, Collection
from typing import Any, Final

from muster_bus import Bus, Received
from muster_schemas.channels import (
    AREAS,
    KEYWORDS,
    MISSION_STATE,
    OBJECT,
    ROBOT_ALIVE,
    ROBOT_CARD,
    ROBOT_STATE,
    SERVICE_ALIVE,
    TASK_STATE,
    Channel,
)
from muster_schemas.robot import RobotCard, RobotState
from muster_schemas.site import Site
from muster_schemas.world import AreaRules, Keywords, MapObject
from pydantic import BaseModel

from .events import Event, Hub
from .surroundings import Surroundings, letters_of, object_classes

LOOK_S: Final = 3.0
"""How long the cameras get to find an object."""

GONE_S: Final = 3.0
"""How long a robot's token must be gone before the robot counts as gone; a change of routers takes milliseconds."""

_GATHER_S: Final = 5.0
"""After its start the planner waits this long for the robots of the site's file before it plans without them."""

_ROBOT_EVENT_S: Final = 0.5
"""At least this long between two events of one robot, unless more than its place has changed."""


class FleetRobot(RobotCard):
    """A robot's card, whether it is there, and its last state."""

    online: bool
    state: RobotState | None = None


class SiteView:
    """Follows the bus while `run` runs; a `drafting.Scene`."""

    def __init__(self, bus: Bus, site: Site, hub: Hub) -> None:
        self._bus = bus
        self._site = site
        self._hub = hub
        self._catalogue = site.catalogue
        self._cards: dict[str, RobotCard] = {}
        self._states: dict[str, RobotState] = {}
        self._gone_at: dict[tuple[str, str], float | None] = {}
        """(robot, boot id) -> when its token went, None while it is there."""
        self._services: dict[str, set[str]] = {}
        self._objects: dict[str, MapObject] = {}
        self._rules = AreaRules(revision=0)
        self._sent: dict[str, tuple[float, object]] = {}
        self._looked_for: dict[str, float] = {}
        self._changed = asyncio.Event()
        self._born = time.monotonic()

    @property
    def objects(self) -> list[MapObject]:
        """What the map holds, by name."""
        return [self._objects[name] for name in sorted(self._objects)]

    @property
    def rules(self) -> AreaRules:
        """Who keeps out of what."""
        return self._rules

    @property
    def fleet(self) -> list[FleetRobot]:
        """Every robot that was seen since the start, by id."""
        return [self._fleet_robot(card) for _, card in sorted(self._cards.items())]

    def is_alive(self, service: str) -> bool:
        """Return whether a service holds its token."""
        return bool(self._services.get(service))

    def now(self) -> Surroundings:
        """Return the robots that are there, and the objects on the map or in a rule, which may outlive its object."""
        return Surroundings(
            roster=tuple(card for _, card in sorted(self._cards.items()) if self._is_there(card)),
            objects=tuple(sorted(self._objects.keys() | {r.object_name for r in self._rules.rules})),
            catalogue=self._catalogue,
            letters=letters_of(self._site),
            classes=object_classes(self._site),
        )

    async def gathered(self) -> None:
        """Wait until the robots of the site's file are there, or until `_GATHER_S` after the start."""
        while {r.id for r in self._site.robots} - {c.robot_id for c in self.now().roster}:
            left = self._born + _GATHER_S - time.monotonic()
            if left <= 0 or not await self._change_within(left):
                return

    async def look_for(self, names: Collection[str]) -> None:
        """Ask the cameras for what the map lacks; return when it is there or after `LOOK_S`."""
        now = time.monotonic()
        self._looked_for = {n: at for n, at in self._looked_for.items() if now - at < 2 * LOOK_S}
        missing = {n for n in names if n not in self._objects and n not in self._looked_for}
        if not missing:
            return
        self._looked_for.update(dict.fromkeys(missing, now))
        classes = sorted({re.sub(r"[_-]?\d+$", "", n)[:64] for n in missing} - {""})[:64]
        if classes:
            self._bus.publish(KEYWORDS, Keywords(keywords=tuple(classes), asked_by="planner", for_s=2 * LOOK_S))
        while missing - self._objects.keys():
            left = now + LOOK_S - time.monotonic()
            if left <= 0 or not await self._change_within(left):
                return

    async def run(self) -> None:
        """Follow the bus until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._follow(ROBOT_CARD, self._on_card))
            tasks.create_task(self._follow(ROBOT_STATE, self._on_state))
            tasks.create_task(self._follow(OBJECT, self._on_object))
            tasks.create_task(self._follow(AREAS, self._on_areas))
            tasks.create_task(self._follow(MISSION_STATE, self._pass_on("mission")))
            tasks.create_task(self._follow(TASK_STATE, self._pass_on("task")))
            tasks.create_task(self._watch_robots())
            tasks.create_task(self._watch_services())

    async def _follow(self, channel: Channel[Any], handle: Callable[[Received[Any]], None]) -> None:
        async with self._bus.subscribe(channel) as messages:
            async for received in messages:
                handle(received)

    def _on_card(self, received: Received[RobotCard]) -> None:
        robot_id = received.ids["robot_id"]
        if received.message is None:
            self._cards.pop(robot_id, None)
        else:
            self._cards[robot_id] = received.message
        self._robot_changed(robot_id)

    def _on_state(self, received: Received[RobotState]) -> None:
        if received.message is not None:
            self._states[received.message.robot_id] = received.message
            self._send_robot(received.message.robot_id)

    def _on_object(self, received: Received[MapObject]) -> None:
        name = received.ids["object_name"]
        if received.message is None:
            self._objects.pop(name, None)
            self._send("object", {"name": name, "gone": True})
        else:
            self._objects[name] = received.message
            self._send("object", received.message)
        self._wake()

    def _on_areas(self, received: Received[AreaRules]) -> None:
        self._rules = received.message or AreaRules(revision=0)
        self._send("areas", self._rules)

    def _pass_on(self, kind: str) -> Callable[[Received[Any]], None]:
        def handle(received: Received[Any]) -> None:
            self._send(kind, received.message if received.message is not None else {**received.ids, "gone": True})

        return handle

    async def _watch_robots(self) -> None:
        async with self._bus.watch(ROBOT_ALIVE) as changes:
            async for presence in changes:
                robot_id, boot_id = presence.ids["robot_id"], presence.ids["boot_id"]
                self._gone_at[robot_id, boot_id] = None if presence.alive else time.monotonic()
                self._forget_old_lives(robot_id)
                self._robot_changed(robot_id)

    async def _watch_services(self) -> None:
        async with self._bus.watch(SERVICE_ALIVE) as changes:
            async for presence in changes:
                lives = self._services.setdefault(presence.ids["service"], set())
                (lives.add if presence.alive else lives.discard)(presence.ids["boot_id"])

    def _is_there(self, card: RobotCard) -> bool:
        """Return whether the robot's token is there, or was until moments ago; without a link nobody can tell."""
        gone_at = self._gone_at.get((card.robot_id, card.boot_id), 0.0)
        return gone_at is None or time.monotonic() - gone_at < GONE_S or not self._bus.connected

    def _forget_old_lives(self, robot_id: str) -> None:
        card = self._cards.get(robot_id)
        for life, gone_at in list(self._gone_at.items()):
            of_another_life = life[0] == robot_id and card is not None and life[1] != card.boot_id
            if of_another_life and gone_at is not None and time.monotonic() - gone_at > 60:
                del self._gone_at[life]

    def _fleet_robot(self, card: RobotCard) -> FleetRobot:
        state = self._states.get(card.robot_id)
        return FleetRobot(**card.model_dump(), online=self._is_there(card), state=state)

    def _robot_changed(self, robot_id: str) -> None:
        self._send_robot(robot_id)
        self._wake()

    def _send_robot(self, robot_id: str) -> None:
        """Tell listeners of a robot, but of its driving only every `_ROBOT_EVENT_S`."""
        card = self._cards.get(robot_id)
        if card is None or not self._hub.listeners:
            return
        robot = self._fleet_robot(card)
        state = robot.state
        what = (robot.boot_id, robot.online, state and (state.busy_with, state.fault, state.load.bodies))
        at, before = self._sent.get(robot_id, (0.0, None))
        if what != before or time.monotonic() - at >= _ROBOT_EVENT_S:
            self._sent[robot_id] = (time.monotonic(), what)
            self._send("robot", robot)

    def _send(self, kind: str, message: BaseModel | dict[str, Any]) -> None:
        if self._hub.listeners:
            data = message.model_dump_json(by_alias=True) if isinstance(message, BaseModel) else json.dumps(message)
            self._hub.send(Event(kind, data))

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    async def _change_within(self, seconds: float) -> bool:
        """Return True at the next change of robots or objects, False if there is none in that time."""
        try:
            async with asyncio.timeout(seconds):
                await self._changed.wait()
        except TimeoutError:
            return False
        return True
