"""The asyncio shell around the engine: what comes in from the bus, in which order, and when time passes."""

import asyncio
import time
from collections.abc import Callable
from typing import Final, TypeVar

import structlog
from muster_bus import Bus, Presence, Received
from muster_schemas.base import Message
from muster_schemas.channels import (
    OBJECT,
    ROBOT_ALIVE,
    ROBOT_CARD,
    ROBOT_STATE,
    ROBOT_STOP_STATUS,
    SKILL_STATUS,
    Channel,
)
from muster_schemas.robot import RobotCard, RobotState, SkillStatus
from muster_schemas.site import Site
from muster_schemas.stops import StopStatus
from muster_schemas.world import MapObject

from .core.core import Core
from .core.events import AnyEvent, Policy, StatusReceived, StopObeyed
from .engine import Engine, Wish
from .housekeeping import Housekeeping, MakeSnapshot
from .journal import Journal
from .outbox import Outbox
from .policy.world import World
from .replanning import Replanner
from .rpc import Desk
from .sightings import Sightings

LOOK_S: Final = 0.25
"""How often robots are looked at for what only time changes, such as being late."""
TURN_S: Final = 0.1
"""The longest time between two turns, for repeats and deadlines."""

M = TypeVar("M", bound=Message)

_log = structlog.stdlib.get_logger(__name__)


class Shell:
    """One running scheduler."""

    def __init__(self, bus: Bus, site: Site, core: Core, journal: Journal, make_snapshot: MakeSnapshot) -> None:
        self._bus = bus
        self._sightings = Sightings(World(bounds=site.bounds), time.monotonic())
        self._outbox = Outbox(bus)
        self._engine = Engine(core, journal, self._outbox, self._sightings)
        self._journal = journal
        self._housekeeping = Housekeeping(self._engine, journal, make_snapshot)
        self._site = site
        self._waiting: list[Wish] = []
        self._turn_is_due = False
        self._broken: asyncio.Future[None] | None = None
        """Ends `run` with what a turn failed with; there while it runs."""
        self._looked_at = 0.0

    async def run(self, stop: asyncio.Event, policy: Policy) -> None:
        """Resume every mission and work until asked to stop."""
        self._engine.start(self._site.skills, policy)
        desk = Desk(self._engine, self.do, self._outbox, self._journal)
        replanner = Replanner(self._bus, self.do, desk.admit)
        async with asyncio.TaskGroup() as group, desk.serve(self._bus):
            readers = [
                group.create_task(self._read(OBJECT, self._on_object), name="objects"),
                group.create_task(self._read(ROBOT_CARD, self._on_card), name="cards"),
                group.create_task(self._read(ROBOT_STATE, self._on_state), name="states"),
                group.create_task(self._read(SKILL_STATUS, self._on_status), name="statuses"),
                group.create_task(self._read(ROBOT_STOP_STATUS, self._on_stopped), name="stops"),
                group.create_task(self._watch(), name="robots alive"),
                group.create_task(self._housekeeping.run(), name="housekeeping"),
            ]
            readers.append(group.create_task(self._keep_time(replanner), name="time"))
            stopping = group.create_task(stop.wait(), name="stop")
            self._broken = asyncio.get_running_loop().create_future()
            _log.info("serving")
            await asyncio.wait((self._broken, stopping), return_when=asyncio.FIRST_COMPLETED)
            await replanner.close()
            for task in (*readers, stopping):
                task.cancel()
            if self._broken.done():
                await self._broken
        self._broken = None

    async def do(self, make: Callable[[float], AnyEvent]) -> None:
        """Have an event happen, with the others that wait; return when it is in the journal and its effects are out.

        Raises:
            NotPossibleError: it cannot be; nothing has changed.
            JournalUnavailableError: it could not be written; nothing has changed.

        """
        await asyncio.wrap_future(self._want(make(self._engine.now())).done)

    def _soon(self) -> None:
        """Have a turn as soon as the readers have taken what is there: what came together is one commit.

        A callback and not a task, since each switch of tasks would be paid by the robot that waits for its request.
        """
        if not self._turn_is_due:
            self._turn_is_due = True
            asyncio.get_running_loop().call_soon(self._turn)

    def _turn(self) -> None:
        """Let happen what is wanted and what is due."""
        self._turn_is_due = False
        broken = self._broken
        if broken is None or broken.done():
            return
        wishes, self._waiting = self._waiting, []
        try:
            self._engine.step(wishes)
        except Exception as error:  # noqa: BLE001  (ends the service; a callback has nobody else to tell)
            broken.set_exception(error)

    async def _keep_time(self, replanner: Replanner) -> None:
        """Do at intervals what only the passing of time asks for."""
        while True:
            now = time.monotonic()
            self._sightings.link(now, up=self._bus.connected)
            if now - self._looked_at >= LOOK_S:
                self._looked_at = now
                self._sightings.look_at_all()
            self._soon()
            self._outbox.repeat(self._engine.now(), now)
            replanner.ask(self._outbox.take_questions())
            await asyncio.sleep(TURN_S)

    def _want(self, event: AnyEvent) -> Wish:
        wish = Wish(event)
        self._waiting.append(wish)
        self._soon()
        return wish

    async def _read(self, channel: Channel[M], take: Callable[[Received[M]], None]) -> None:
        async with self._bus.subscribe(channel) as messages:
            async for received in messages:
                take(received)

    async def _watch(self) -> None:
        async with self._bus.watch(ROBOT_ALIVE) as changes:
            async for change in changes:
                self._on_alive(change)

    def _on_object(self, received: Received[MapObject]) -> None:
        self._sightings.object(received.ids["object_name"], received.message)
        self._soon()

    def _on_card(self, received: Received[RobotCard]) -> None:
        if received.message is not None:
            self._sightings.card(received.message)
            self._soon()

    def _on_state(self, received: Received[RobotState]) -> None:
        if received.message is not None and self._sightings.state(received.message, time.monotonic()):
            self._soon()

    def _on_status(self, received: Received[SkillStatus]) -> None:
        if received.message is not None:
            self._want(StatusReceived(at=self._engine.now(), status=received.message))

    def _on_stopped(self, received: Received[StopStatus]) -> None:
        if received.message is not None:
            self._want(StopObeyed(at=self._engine.now(), status=received.message))

    def _on_alive(self, change: Presence) -> None:
        self._sightings.token(change.ids["robot_id"], change.ids["boot_id"], time.monotonic(), alive=change.alive)
        self._soon()
