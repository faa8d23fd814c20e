"""The one door to the state: `Core.handle(event) -> list[Effect]`."""

from muster_schemas.mission import TaskStatus

from . import archive, attempts, failures, missions, presence, readiness, stops
from .effects import Effect
from .errors import NotPossibleError
from .events import (
    AnyEvent,
    MissionControlled,
    MissionReplanned,
    MissionsArchived,
    MissionSubmitted,
    ObjectsChanged,
    RobotOffline,
    RobotOnline,
    RulesObeyed,
    SelectorBound,
    Started,
    StatusReceived,
    StopObeyed,
    StopOrdered,
    TaskBlocked,
    TaskDeferred,
    TaskDispatched,
    TaskImpossible,
    Tick,
)
from .state import Agenda, State
from .transitions import InvalidTransition
from .turn import Turn


class Core:
    """The state and what events do to it. Pure: the same events always give the same state and the same effects."""

    def __init__(self, state: State | None = None) -> None:
        self.state = state or State()

    def handle(self, event: AnyEvent) -> list[Effect]:
        """Change the state by one event and return what is to be done about it.

        Raises:
            NotPossibleError: the event is a caller's wish that cannot be; nothing has changed.
            InvalidTransition: a bug; the state must be built again from the journal.

        """
        before = self.state.now
        turn = Turn(self.state, event.at)
        try:
            self._apply(turn, event)
        except NotPossibleError:
            self.state.now = before  # nothing has changed, not even the time: this event will not be in the journal
            raise
        return turn.end()

    def _apply(self, turn: Turn, event: AnyEvent) -> None:
        match event:
            case StatusReceived():
                attempts.hear(turn, event.status)
            case StopOrdered():
                stops.order(turn, event)
            case StopObeyed():
                stops.hear(turn, event.status)
            case MissionSubmitted():
                missions.submit(turn, event)
            case MissionControlled():
                missions.control(turn, event)
            case MissionReplanned():
                failures.replanned(turn, event)
            case MissionsArchived():
                archive.forget(turn, event)
            case Tick():
                presence.tick(turn)
            case SelectorBound():
                self._bind(turn, event)
            case TaskDispatched() | TaskBlocked() | TaskDeferred() | TaskImpossible():
                self._decided(turn, event)
            case Started() | RobotOnline() | RobotOffline() | RulesObeyed() | ObjectsChanged():
                presence.seen(turn, event)

    def take_agenda(self) -> Agenda:
        """Return what policy should look at now, and forget it."""
        agenda = self.state.agenda
        self.state.agenda = Agenda()
        return agenda

    def next_deadline(self) -> float | None:
        """Return the time at which a `Tick` is wanted, if any."""
        return self.state.timers[0][0] if self.state.timers else None

    def _decided(self, turn: Turn, event: TaskDispatched | TaskBlocked | TaskDeferred | TaskImpossible) -> None:
        task = self.state.task((event.mission_id, event.task_id))
        if task is None or task.state is not TaskStatus.READY:
            start, story = (task.state, task.story) if task else ("nowhere", ())
            raise InvalidTransition(f"task {event.mission_id}/{event.task_id}", start, event.kind, story)
        match event:
            case TaskDispatched():
                attempts.dispatch(turn, task, event)
            case TaskBlocked():
                attempts.blocked(turn, task, event.waiting_for)
            case TaskDeferred():
                attempts.deferred(turn, task, event.until, event.waiting_for)
            case TaskImpossible():
                failures.come_to_nothing(turn, task, event.reason)

    @staticmethod
    def _bind(turn: Turn, event: SelectorBound) -> None:
        mission = turn.state.missions[event.mission_id]
        mission.bound[event.selector] = event.robots
        for task in mission.tasks.values():
            if not task.state.ended:
                readiness.bind(turn, mission, task)
                readiness.refresh(turn, task)
        for robot_id in event.robots:
            # whoever stood back for this one may have them beside it, or find others
            if robot_id in turn.state.robots:
                readiness.robot_changed(turn, turn.state.robots[robot_id])
