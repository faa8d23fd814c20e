"""The one place where events become durable and effects go out, in this order: commit, publish, answer.

Everything here happens between two turns of the event loop, so whoever looks at the core sees only what is committed.
"""

import time
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field

import structlog
from muster_bus import crash
from muster_schemas.skills import Skill

from .core import attempts, requests, stops
from .core.core import Core
from .core.effects import Effect
from .core.errors import NotPossibleError
from .core.events import AnyEvent, Policy, Started, StatusReceived, StopObeyed, Tick
from .journal import Journal, JournalUnavailableError
from .outbox import Outbox
from .policy.assignment import Assignment
from .policy.decide import advance
from .recovery import replay
from .sightings import Sightings

_log = structlog.stdlib.get_logger(__name__)


@dataclass(slots=True)
class Wish:
    """An event that wants to happen, and what became of it."""

    event: AnyEvent
    done: "Future[None]" = field(default_factory=Future["None"])
    """Ends when the event is in the journal and its effects are out, or with why it did not happen."""


class Engine:
    """The core with its journal and its outbox."""

    def __init__(self, core: Core, journal: Journal, outbox: Outbox, sightings: Sightings) -> None:
        self._journal = journal
        self._outbox = outbox
        self._sightings = sightings
        self._assignment = Assignment()
        self.core = core
        self._clock_offset = max(time.time(), self.core.state.now) - time.monotonic()
        self._unavailable = False

    def now(self) -> float:
        """Return the wall time; it never goes back, not even over a restart."""
        return time.monotonic() + self._clock_offset

    def start(self, skills: tuple[Skill, ...], policy: Policy) -> None:
        """Begin a new epoch.

        Raises:
            JournalUnavailableError: the disk does not take it.

        """
        epoch = self.core.state.epoch + 1
        wish = Wish(Started(at=self.now(), epoch=epoch, skills=skills, policy=policy))
        self.step([wish])
        wish.done.result(0)
        _log.info("started", epoch=epoch, missions=len(self.core.state.missions))

    def step(self, wishes: Sequence[Wish]) -> None:
        """Let everything happen that is due, as one batch with one fsync."""
        if self._unavailable and not self._is_available_again(wishes):
            return
        seen = [Wish(e) for e in self._sightings.events(self.core.state, self.now(), time.monotonic())]
        batch = [*seen, *wishes]
        deadline = self.core.next_deadline()
        if deadline is not None and deadline <= self.now():
            batch.append(Wish(Tick(at=self.now())))
        if batch:
            self._run(batch)

    def _run(self, batch: Sequence[Wish]) -> None:
        """Handle a batch; if one of its events breaks the core, do the others without it."""
        events: list[AnyEvent] = []
        effects: list[Effect] = []
        happened: list[Wish] = []
        for wish in batch:
            try:
                more_events, more_effects = self._handle(wish.event)
            except NotPossibleError as error:
                wish.done.set_exception(error)
                continue
            except Exception as error:  # noqa: BLE001  (whatever it is, the site must go on)
                _log.exception("event_failed", what=wish.event.model_dump(mode="json"))
                self.core = replay(self._journal)
                rest = [w for w in batch if w is not wish and not w.done.done()]
                wish.done.set_exception(error)
                if rest:
                    self._run(rest)
                return
            events += more_events
            effects += more_effects
            happened.append(wish)
        self._finish(events, effects, happened)

    def _handle(self, event: AnyEvent) -> tuple[list[AnyEvent], list[Effect]]:
        state = self.core.state
        if isinstance(event, StatusReceived) and not attempts.is_news(state, event.status):
            # late, repeated or not ours: nothing to write down, but its sender may rest
            return [], [requests.acknowledgement(state, event.status)] if event.status.state.final else []
        if isinstance(event, StopObeyed) and not stops.is_news(state, event.status):
            return [], []
        return advance(self.core, event, self._sightings.world, self._assignment)

    def _finish(self, events: list[AnyEvent], effects: list[Effect], happened: list[Wish]) -> None:
        # 1. commit
        if events:
            crash.point("commit")
            try:
                self._journal.append(events)
            except JournalUnavailableError as error:
                self._give_up(happened, error)
                return
            crash.point("committed")
        # 2. publish, send, acknowledge
        self._outbox.carry_out(effects, self.now(), time.monotonic())
        # 3. answer
        crash.point("sent")
        for wish in happened:
            wish.done.set_result(None)

    def _give_up(self, wishes: Sequence[Wish], error: JournalUnavailableError) -> None:
        """Forget what could not be written: nothing of it went out. Agents and sightings will say it again."""
        if not self._unavailable:
            _log.error("journal_unavailable", error=str(error))
        self._unavailable = True
        self.core = replay(self._journal)
        self._refuse(wishes, error)

    def _is_available_again(self, wishes: Sequence[Wish]) -> bool:
        try:
            self._journal.probe()
        except JournalUnavailableError as error:
            self._refuse(wishes, error)
            return False
        _log.info("journal_available")
        self._unavailable = False
        self._sightings.look_at_all()
        return True

    @staticmethod
    def _refuse(wishes: Sequence[Wish], error: Exception) -> None:
        for wish in wishes:
            wish.done.set_exception(error)
