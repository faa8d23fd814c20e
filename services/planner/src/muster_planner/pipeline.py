"""The planner's work: every mission in `planning` gets a plan or the reasons why there is none.

The scheduler's journal is the queue: a mission that was accepted stands there in `planning`, so this process may die at
any point and finds its work again. Missions come in three ways that mean the same: from the REST API that has just
submitted one, from the missions' states on the bus, and from a sweep that asks the scheduler now and then.
"""

import asyncio
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from functools import partial
from typing import Final

import structlog
from muster_bus import Bus, NoReplyError, RefusedError
from muster_schemas.channels import MISSION_STATE
from muster_schemas.mission import MissionState, MissionStatus, Reason
from muster_schemas.plan import Plan
from muster_schemas.rpc import ErrorCode, ReplanMission, ReplanReply

from .drafting import Limits, Outcome, draft_plan
from .instructions import InstructionError, clean_instruction
from .llm import PlanningModel
from .metrics import Metrics
from .replanning import background, rest_in_words
from .scheduler import Scheduler
from .site_view import SiteView
from .turns import Turns

_log = structlog.stdlib.get_logger(__name__)

_SWEEP_S: Final = 10.0
_RETRY_S: Final = 1.0
_REMEMBERED: Final = 1_000
"""Missions whose end of planning is remembered, against late news that they are still in `planning`."""


class QueueFullError(Exception):
    """As many instructions wait as may; come back later."""


class _NotPlanningError(Exception):
    """The mission is not in `planning` any more: cancelled, or planned by an earlier life of this process."""


class Pipeline:
    """Plans missions and dry runs; `run` must be running."""

    def __init__(
        self, bus: Bus, model: PlanningModel, view: SiteView, metrics: Metrics, limits: Limits, room: int
    ) -> None:
        self._bus = bus
        self._scheduler = Scheduler(bus)
        self._model = model
        self._view = view
        self._metrics = metrics
        self._limits = limits
        self._room = room
        self._turns = Turns()
        self._jobs: dict[str, asyncio.Task[None]] = {}
        self._delivering: set[str] = set()
        self._done: OrderedDict[str, int] = OrderedDict()
        """mission id -> its newest revision when its planning ended"""
        self._replans: dict[tuple[str, str, int], asyncio.Task[ReplanReply]] = {}
        self._dry_runs = 0
        self._tasks: asyncio.TaskGroup | None = None

    @property
    def waiting(self) -> int:
        """Instructions that wait for their plan or are planned now."""
        return len(self._jobs) + self._dry_runs

    @property
    def full(self) -> bool:
        """Whether no further instruction may be taken on."""
        return self.waiting >= self._room

    def add(self, mission: MissionState) -> None:
        """Plan a mission, if it is in `planning`, not known yet, and there is room (else the sweep brings it again)."""
        if self._tasks is None or mission.state is not MissionStatus.PLANNING or self.full:
            return
        if mission.mission_id in self._jobs or mission.revision <= self._done.get(mission.mission_id, -1):
            return
        job = self._tasks.create_task(self._plan(mission), name=f"plan {mission.mission_id}")
        self._jobs[mission.mission_id] = job
        self._count()
        job.add_done_callback(lambda _: self._ended(mission.mission_id))

    async def add_by_id(self, mission_id: str) -> None:
        """Plan a mission that was submitted just now; if the scheduler is silent, its state on the bus does it."""
        try:
            view = await self._scheduler.mission(mission_id)
        except (NoReplyError, RefusedError):
            return
        if view is not None:
            self.add(view.mission)

    async def dry_run(self, text: str, priority: int) -> Outcome:
        """Plan an instruction without making a mission.

        Raises:
            QueueFullError: come back later.

        """
        if self.full:
            raise QueueFullError
        self._dry_runs += 1
        self._count()
        try:
            await self._view.gathered()
            outcome = await draft_plan(
                text, self._model, self._view, limits=self._limits, take_turn=partial(self._turn, priority)
            )
        finally:
            self._dry_runs -= 1
            self._count()
        self._metrics.planned(outcome)
        return outcome

    async def replan(self, question: ReplanMission) -> ReplanReply:
        """Plan the rest of a mission anew; the same question again waits for the same answer."""
        key = (question.mission_id, question.task_id, question.number)
        if key not in self._replans:
            self._replans[key] = asyncio.create_task(self._plan_rest(question), name=f"replan {key}")
            self._replans[key].add_done_callback(lambda _: self._replans.pop(key, None))
        return await asyncio.shield(self._replans[key])

    async def _plan_rest(self, question: ReplanMission) -> ReplanReply:
        await self._view.gathered()
        there = self._view.now()
        outcome = await draft_plan(
            rest_in_words(question, there.roster, there.catalogue),
            self._model,
            self._view,
            limits=self._limits,
            take_turn=partial(self._turn, question.priority),
            background=background(question),
        )
        self._metrics.planned(outcome)
        _log.info("replanned", mission_id=question.mission_id, reasons=[r.code for r in outcome.reasons])
        return ReplanReply(plan=outcome.plan, reasons=outcome.reasons)

    async def run(self) -> None:
        """Work until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            self._tasks = tasks
            tasks.create_task(self._follow(), name="follow missions")
            tasks.create_task(self._sweep(), name="sweep missions")

    async def _follow(self) -> None:
        """Take on missions as they appear, and drop those that are cancelled."""
        async with self._bus.subscribe(MISSION_STATE) as messages:
            async for received in messages:
                mission = received.message
                if mission is None:
                    continue
                self.add(mission)
                job = self._jobs.get(mission.mission_id)
                if mission.state is not MissionStatus.PLANNING and job and mission.mission_id not in self._delivering:
                    _log.info("planning_dropped", mission_id=mission.mission_id, state=mission.state)
                    job.cancel()

    async def _sweep(self) -> None:
        while True:
            try:
                views = await self._scheduler.missions((MissionStatus.PLANNING,), limit=1000)
            except (NoReplyError, RefusedError) as error:
                _log.warning("scheduler_silent", error=str(error)[:300])
                await asyncio.sleep(_RETRY_S)
                continue
            for view in reversed(views):
                self.add(view.mission)
            await asyncio.sleep(_SWEEP_S)

    async def _plan(self, mission: MissionState) -> None:
        mission_id = mission.mission_id
        try:
            await self._view.gathered()
            outcome = await self._outcome(mission)
            if outcome.plan is None:
                await self._deliver(mission_id, reasons=outcome.reasons)
            self._metrics.planned(outcome)
            _log.info(
                "planned" if outcome.plan else "rejected",
                mission_id=mission_id,
                attempts=outcome.attempts,
                model_s=round(outcome.model_s, 3),
                tokens=outcome.tokens,
                reasons=[r.code for r in outcome.reasons],
            )
        except _NotPlanningError:
            _log.info("planning_superseded", mission_id=mission_id)
        except Exception:  # noqa: BLE001 (logged; a fault here must not end the planning of the other missions)
            _log.exception("planning_failed", mission_id=mission_id)
            fault = Reason(code="planner_fault", message="The planner failed at this instruction; its log says why.")
            await self._deliver_fault(mission_id, fault)
        self._remember(mission)

    async def _outcome(self, mission: MissionState) -> Outcome:
        try:
            text = clean_instruction(mission.text)
        except InstructionError as error:
            return Outcome(plan=None, reasons=(Reason(code="no_instruction", message=str(error)),))
        return await draft_plan(
            text,
            self._model,
            self._view,
            limits=self._limits,
            accept=partial(self._deliver_plan, mission.mission_id),
            take_turn=partial(self._turn, mission.priority),
        )

    def _turn(self, priority: int) -> AbstractAsyncContextManager[None]:
        return self._turns.take(priority)

    async def _deliver_plan(self, mission_id: str, plan: Plan) -> Sequence[Reason]:
        return await self._deliver(mission_id, plan=plan)

    async def _deliver_fault(self, mission_id: str, fault: Reason) -> None:
        try:
            await self._deliver(mission_id, reasons=(fault,))
        except _NotPlanningError:
            _log.info("planning_superseded", mission_id=mission_id)

    async def _deliver(
        self, mission_id: str, *, plan: Plan | None = None, reasons: tuple[Reason, ...] = ()
    ) -> Sequence[Reason]:
        """Tell the scheduler the plan or the reasons, until it has answered; return its own reasons against the plan.

        Raises:
            _NotPlanningError: the mission does not wait for this any more.

        """
        self._delivering.add(mission_id)
        try:
            while True:
                try:
                    if plan is not None:
                        await self._scheduler.set_plan(mission_id, plan)
                    else:
                        await self._scheduler.refuse(mission_id, reasons)
                except NoReplyError:
                    await self._still_planning(mission_id)
                except RefusedError as error:
                    if error.error.code in (ErrorCode.CONFLICT, ErrorCode.NOT_FOUND):
                        raise _NotPlanningError from error
                    if error.error.code is ErrorCode.INVALID:
                        return error.error.reasons or (Reason(code="invalid", message=error.error.message[:1000]),)
                    _log.warning("scheduler_refused", mission_id=mission_id, error=str(error)[:300])
                    await asyncio.sleep(_RETRY_S)
                else:
                    return ()
        finally:
            self._delivering.discard(mission_id)

    async def _still_planning(self, mission_id: str) -> None:
        """Return once the scheduler says that the mission still waits for its plan.

        Raises:
            _NotPlanningError: it does not; the call that went without an answer may have done it.

        """
        while True:
            try:
                view = await self._scheduler.mission(mission_id)
            except (NoReplyError, RefusedError):
                await asyncio.sleep(_RETRY_S)
                continue
            if view is None or view.mission.state is not MissionStatus.PLANNING:
                raise _NotPlanningError
            return

    def _remember(self, mission: MissionState) -> None:
        self._done[mission.mission_id] = mission.revision
        if len(self._done) > _REMEMBERED:
            self._done.popitem(last=False)

    def _ended(self, mission_id: str) -> None:
        self._jobs.pop(mission_id, None)
        self._count()

    def _count(self) -> None:
        self._metrics.waiting.set(self.waiting)
