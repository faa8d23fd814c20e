"""What planner, console and CLI ask of the scheduler: submit, control, missions, rules."""

import asyncio
import contextlib
import heapq
import time
from collections.abc import AsyncGenerator, Awaitable, Callable, Generator, Iterable, Iterator, Sequence
from itertools import islice
from typing import Final

from muster_bus import Bus, Refusal
from muster_schemas.channels import CONTROL, MISSIONS, RULES, STOP, SUBMIT
from muster_schemas.gate import check_plan, unknown_objects
from muster_schemas.ids import new_id
from muster_schemas.mission import MissionStatus, MissionView, Reason
from muster_schemas.plan import MAX_TASKS, Plan
from muster_schemas.rpc import (
    ControlMission,
    ControlReply,
    ErrorCode,
    ErrorReply,
    MissionAction,
    MissionsQuery,
    MissionsReply,
    RulesQuery,
    SubmitMission,
)
from muster_schemas.stops import StopReply, StopRobots
from muster_schemas.world import AreaRules

from .core import stops
from .core.core import Core
from .core.errors import NotPossibleError
from .core.events import AnyEvent, MissionControlled, MissionSubmitted, StopOrdered
from .core.missions import changes_nothing, is_possible, is_so_already
from .core.outcomes import NO_WORD
from .core.state import Mission, Presence, State
from .core.views import mission_state, mission_view
from .engine import Engine
from .journal import Journal, JournalCorruptError, JournalUnavailableError
from .outbox import Outbox
from .policy.approval import why_ask

LOOK_FOR_S: Final = 3.0
"""How long a plan waits for its objects to be found before it is refused."""
POLL_S: Final = 0.05
CANCEL_REPLY_S: Final = 1.0
"""How long a cancel or stop waits for the robots' words before it answers with what is known."""
LISTED_TASKS: Final = 10_000
"""Of a list of missions, so many tasks are told; missions beyond come without plan and tasks."""
ROBOTS_MAY_COME: Final = frozenset({"unknown_robot", "unknown_type", "too_few_robots", "not_all_robots"})

Do = Callable[[Callable[[float], AnyEvent]], Awaitable[None]]


class Desk:
    """Answers the scheduler's queries."""

    def __init__(self, engine: Engine, do: Do, outbox: Outbox, journal: Journal) -> None:
        self._engine = engine
        self._do = do
        self._outbox = outbox
        self._journal = journal
        self._opened_at = time.monotonic()

    @contextlib.asynccontextmanager
    async def serve(self, bus: Bus) -> AsyncGenerator[None]:
        """Answer while entered."""
        async with (
            bus.serve(SUBMIT, self.submit),
            bus.serve(CONTROL, self.control),
            bus.serve(MISSIONS, self.missions),
            bus.serve(STOP, self.stop),
            bus.serve(RULES, self.rules),
        ):
            yield

    async def submit(self, request: SubmitMission) -> ControlReply:
        """Make a mission, or return the one that the same idempotency key has made."""
        known = self._by_key(request)
        if known is not None:
            return _reply(known)
        if request.plan is not None:
            await self._pass_gate(request.plan)
            known = self._by_key(request)
            if known is not None:  # the same request came twice, and the other one was first
                return _reply(known)
        mission_id = new_id("m")
        try:
            await self._happen(
                lambda at: MissionSubmitted(
                    at=at,
                    mission_id=mission_id,
                    text=request.text,
                    tasks=request.plan.tasks if request.plan else None,
                    priority=request.priority,
                    approval=request.approval,
                    idempotency_key=request.idempotency_key,
                    ask_because=self._why_ask(request.plan),
                )
            )
        except Refusal:
            known = self._by_key(request)  # the same request came twice at once, and the other one was first
            if known is None:
                raise
            return _reply(known)
        return _reply(self._state.missions[mission_id])

    async def control(self, request: ControlMission) -> ControlReply:
        """Act on a mission."""
        state = self._state
        archived = self._archived(mission_id=request.mission_id)
        if archived is not None:
            if not is_so_already(archived, request):
                said = f"mission {archived.mission_id} is {archived.state}: {request.action} is not possible now"
                raise Refusal.because(ErrorCode.CONFLICT, said)
            return _reply(archived)
        if not changes_nothing(state, request):
            mission = state.missions.get(request.mission_id)
            if request.action is MissionAction.SET_PLAN:
                if request.plan is None:
                    raise Refusal.because(ErrorCode.INVALID, "set_plan needs a plan")
                if mission is not None and is_possible(mission, request.action):
                    await self._pass_gate(request.plan)
            why = self._why_ask(request.plan if request.action is MissionAction.SET_PLAN else None)
            await self._happen(lambda at: MissionControlled(at=at, control=request, ask_because=why))
        if request.action is MissionAction.CANCEL:
            await self._until(lambda: self._all_said(request.mission_id), CANCEL_REPLY_S)
        return _reply(self._state.missions[request.mission_id])

    async def stop(self, request: StopRobots) -> StopReply:
        """Stop or release a robot or all; answer when each that can be reached has obeyed, or soon after."""
        robot_id = request.robot_id
        if not stops.changes_nothing(self._state, request):
            await self._happen(lambda at: StopOrdered(at=at, robot_id=robot_id, stop=request.stop))
        await self._until(lambda: stops.all_said(self._state, robot_id), CANCEL_REPLY_S)
        return stops.known(self._state, robot_id)

    async def missions(self, query: MissionsQuery) -> MissionsReply:
        """Return one mission or the newest ones."""
        state = self._state
        if query.mission_id is not None:
            mission = state.missions.get(query.mission_id) or self._archived(mission_id=query.mission_id)
            if mission is None:
                raise Refusal.because(ErrorCode.NOT_FOUND, f"there is no mission {query.mission_id}")
            return MissionsReply(missions=(mission_view(mission),))
        views: list[MissionView] = []
        told = 0
        found = _newest_first(state, query.states, query.limit)
        with _readable():
            old = self._journal.archived_newest(query.states, query.limit)
        newest = heapq.merge(found, old, key=lambda m: m.number, reverse=True)
        for mission in islice(_each_once(newest), query.limit):
            told += len(mission.tasks)
            brief = told > LISTED_TASKS
            views.append(MissionView(mission=mission_state(mission)) if brief else mission_view(mission))
        return MissionsReply(missions=tuple(views))

    async def admit(self, plan: Plan) -> tuple[str, ...]:
        """Let a plan through the gate; return why the site's rules want a person to see it.

        Raises:
            Refusal: it cannot run.

        """
        await self._pass_gate(plan)
        return self._why_ask(plan)

    def _why_ask(self, plan: Plan | None) -> tuple[str, ...]:
        state = self._state
        if plan is None or not state.policy.approval:
            return ()
        return why_ask(state.policy.approval, plan.tasks, [r.card for r in state.robots.values()], state.catalogue)

    async def rules(self, _query: RulesQuery) -> AreaRules:
        """Return the area rules that hold."""
        return self._state.rules

    @property
    def _state(self) -> State:
        return self._engine.core.state

    def _by_key(self, request: SubmitMission) -> Mission | None:
        if request.idempotency_key is None:
            return None
        mission_id = self._state.by_idempotency_key.get(request.idempotency_key)
        if mission_id is not None:
            return self._state.missions[mission_id]
        return self._archived(idempotency_key=request.idempotency_key)

    def _archived(self, *, mission_id: str | None = None, idempotency_key: str | None = None) -> Mission | None:
        if mission_id in self._state.missions:
            return None
        with _readable():
            return self._journal.archived(mission_id=mission_id, idempotency_key=idempotency_key)

    async def _happen(self, make: Callable[[float], AnyEvent]) -> None:
        try:
            await self._do(make)
        except NotPossibleError as error:
            raise Refusal.because(error.code, str(error)) from error
        except JournalUnavailableError as error:
            raise Refusal.because(ErrorCode.UNAVAILABLE, f"{error}; nothing has changed, try again later") from error

    async def _pass_gate(self, plan: Plan) -> None:
        """Return if the plan may run; first give the cameras, and just after the start the robots, time to show up."""
        reasons = check(self._engine.core, plan)
        missing = unknown_objects(reasons, plan, known_objects(self._state))
        early = time.monotonic() - self._opened_at < LOOK_FOR_S and any(r.code in ROBOTS_MAY_COME for r in reasons)
        hopeful = {"unknown_object", *(ROBOTS_MAY_COME if early else ())}
        if reasons and (missing or early) and all(r.code in hopeful for r in reasons):
            if missing:
                self._outbox.look_for(missing)
            await self._until(lambda: not check(self._engine.core, plan), LOOK_FOR_S)
            reasons = check(self._engine.core, plan)
        if reasons:
            raise Refusal(
                ErrorReply(
                    code=ErrorCode.INVALID,
                    message=f"The plan cannot run: {' '.join(r.message for r in reasons)}"[:2000],
                    reasons=tuple(reasons),
                )
            )

    def _all_said(self, mission_id: str) -> bool:
        mission = self._state.missions[mission_id]
        return mission.state.ended or NO_WORD not in mission.stopping.values()

    @staticmethod
    async def _until(condition: Callable[[], bool], within_s: float) -> None:
        give_up = time.monotonic() + within_s
        while not condition() and time.monotonic() < give_up:  # noqa: ASYNC110  (it changes by many ways)
            await asyncio.sleep(POLL_S)


def check(core: Core, plan: Plan, *, most: int = MAX_TASKS) -> list[Reason]:
    """Return the gate's reasons against a plan of at most so many tasks, with the robots and objects there are now."""
    state = core.state
    roster = [r.card for _, r in sorted(state.robots.items()) if r.presence is Presence.ONLINE]
    return check_plan(plan, roster, known_objects(state), state.catalogue, most=most)


def known_objects(state: State) -> set[str]:
    """Return the objects of the map, and those that rules are about: a rule can be lifted when its object has gone."""
    return state.objects | {r.object_name for r in state.rules.rules}


def _reply(mission: Mission) -> ControlReply:
    return ControlReply(mission_id=mission.mission_id, state=mission.state, robots=dict(mission.stopping))


@contextlib.contextmanager
def _readable() -> Generator[None]:
    try:
        yield
    except JournalCorruptError as error:
        raise Refusal.because(ErrorCode.UNAVAILABLE, f"an old mission cannot be read: {error}"[:2000]) from error


def _each_once(missions: Iterable[Mission]) -> Iterator[Mission]:
    """Yield missions that come in order of their numbers; one that is just being archived comes twice."""
    last = None
    for mission in missions:
        if mission.number != last:
            yield mission
        last = mission.number


def _newest_first(state: State, states: Sequence[MissionStatus], limit: int) -> Iterable[Mission]:
    if not states:
        return islice(reversed(state.missions.values()), limit)
    found = (state.missions[m] for s in set(states) for m in state.by_state[s])
    return heapq.nlargest(limit, found, key=lambda m: m.number)
