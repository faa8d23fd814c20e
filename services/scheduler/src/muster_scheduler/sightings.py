"""What is seen of robots and objects on the bus, and what of that the core should hear as events.

A robot is LOST only if our own link is up and either the liveliness token of its current life has been gone for
`TOKEN_GONE_S` (a failover between routers makes a healthy robot flap for milliseconds) or its own state is late.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

from muster_schemas.base import Pose
from muster_schemas.channels import ROBOT_STATE
from muster_schemas.robot import RobotCard, RobotState
from muster_schemas.world import MapObject

from .core.events import AnyEvent, ObjectsChanged, RobotOffline, RobotOnline, RulesObeyed
from .core.state import Presence, State
from .policy.world import World

TOKEN_GONE_S = 3.0
STATE_LATE_S = 10 / (ROBOT_STATE.rate_hz or 5.0)
UNSEEN_S = 10.0
"""So long after the start a robot of old that has not shown up counts as lost."""


@dataclass(slots=True)
class _Seen:
    card: RobotCard | None = None
    tokens: dict[str, float | None] = field(default_factory=dict[str, "float | None"])
    """Boot id -> when its token went; None while it is there."""
    heard_at: float | None = None
    """When the current life's state last came."""
    rules_revision: int = 0


class Sightings:
    """Fed by subscriptions; asked for events before anything else is handled. Times are monotonic seconds."""

    def __init__(self, world: World, now: float) -> None:
        self.world = world
        self._robots: dict[str, _Seen] = {}
        self._changed: set[str] = set()
        self._objects_changed = False
        self._started_at = now
        self._link_up_since: float | None = now

    def link(self, now: float, *, up: bool) -> None:
        """Note whether our own link is up: while it is down nobody's absence means anything."""
        if not up:
            self._link_up_since = None
        elif self._link_up_since is None:
            self._link_up_since = now

    def card(self, card: RobotCard) -> None:
        """Take in a robot's card; it stays after the robot has gone."""
        self._robot(card.robot_id).card = card

    def token(self, robot_id: str, boot_id: str, now: float, *, alive: bool) -> None:
        """Take in that an agent's life began or that its token went."""
        seen = self._robot(robot_id)
        if alive:
            for gone in [b for b, t in seen.tokens.items() if t is not None]:
                del seen.tokens[gone]
            seen.tokens[boot_id] = None
        elif boot_id in seen.tokens:
            seen.tokens[boot_id] = now

    def state(self, state: RobotState, now: float) -> bool:
        """Take in a robot's state, unless it is a former life's; return whether there may be an event in it."""
        seen = self._robots.get(state.robot_id)
        if seen is None or seen.card is None or state.boot_id != seen.card.boot_id:
            return False
        late = seen.heard_at is None or now - seen.heard_at > STATE_LATE_S
        is_news = late or state.rules_revision != seen.rules_revision
        if is_news:
            self._changed.add(state.robot_id)
        seen.heard_at = now
        seen.rules_revision = state.rules_revision
        self.world.poses[state.robot_id] = Pose(x=state.pose.x, y=state.pose.y, yaw=state.pose.yaw)
        return is_news

    def object(self, name: str, seen: MapObject | None) -> None:
        """Take in that an object is on the map, or no more."""
        if seen is None:
            self.world.objects.pop(name, None)
        else:
            self.world.objects[name] = seen
        self._objects_changed = True

    def look_at_all(self) -> None:
        """Have `events` look at every robot, for what only the passing of time changes."""
        self._changed.update(self._robots)
        self._objects_changed = True

    def events(self, state: State, at: float, now: float) -> Iterator[AnyEvent]:
        """Yield what the core does not know yet.

        Args:
            state: of the core.
            at: the time for the events.
            now: monotonic.

        """
        if self._objects_changed:
            self._objects_changed = False
            names = set(self.world.objects)
            if names != state.objects:
                appeared, gone = sorted(names - state.objects), sorted(state.objects - names)
                yield ObjectsChanged(at=at, appeared=tuple(appeared), gone=tuple(gone))
        changed, self._changed = self._changed, set()
        for robot_id in sorted(changed):
            yield from self._robot_events(robot_id, state, at, now)
        if now - self._started_at > UNSEEN_S:
            for robot_id in [r for r in state.robots if r not in self._robots]:
                if state.robots[robot_id].presence is Presence.UNSEEN:
                    yield RobotOffline(at=at, robot_id=robot_id, reason="not seen since the scheduler started")

    def _robot_events(self, robot_id: str, state: State, at: float, now: float) -> Iterator[AnyEvent]:
        seen = self._robots[robot_id]
        known = state.robots.get(robot_id)
        if seen.card is None:
            return
        lost = self._why_lost(seen, seen.card, now)
        if lost is None:
            if known is None or known.presence is not Presence.ONLINE or known.card != seen.card:
                yield RobotOnline(at=at, card=seen.card)
        elif known is not None and self._may_judge(now):
            waits = known.presence is Presence.UNSEEN and now - self._started_at <= UNSEEN_S
            if known.presence is not Presence.OFFLINE and not waits:
                yield RobotOffline(at=at, robot_id=robot_id, reason=lost)
        if known is not None and known.rule_tasks and seen.rules_revision > known.rules_revision:
            yield RulesObeyed(at=at, robot_id=robot_id, revision=seen.rules_revision)

    def _may_judge(self, now: float) -> bool:
        return self._link_up_since is not None and now - self._link_up_since >= TOKEN_GONE_S

    @staticmethod
    def _why_lost(seen: _Seen, card: RobotCard, now: float) -> str | None:
        if card.boot_id not in seen.tokens:
            return "its agent is not alive"
        gone_at = seen.tokens[card.boot_id]
        if gone_at is not None and now - gone_at >= TOKEN_GONE_S:
            return f"its agent has been gone for {TOKEN_GONE_S:g} s"
        if seen.heard_at is None or now - seen.heard_at > STATE_LATE_S:
            return f"its state is more than {STATE_LATE_S:g} s late"
        return None

    def _robot(self, robot_id: str) -> _Seen:
        self._changed.add(robot_id)
        return self._robots.setdefault(robot_id, _Seen())
