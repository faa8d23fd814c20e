"""Asks the planner for new plans for the rest of missions, until it answers or has been silent for too long.

Questions follow from the journal, so after a restart those without an answer are asked again.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterable
from typing import Final

import structlog
from muster_bus import Bus, NoReplyError, Refusal, RefusedError
from muster_schemas.channels import REPLAN
from muster_schemas.mission import Reason
from muster_schemas.plan import Plan, PlanTask
from muster_schemas.rpc import ReplanMission, ReplanReply

from .core.events import AnyEvent, MissionReplanned
from .storage.port import JournalUnavailableError

ANSWER_S: Final = 150.0
"""How long the planner may think about one question."""
PAUSE_S: Final = 2.0
GIVE_UP_S: Final = 600.0

_log = structlog.stdlib.get_logger(__name__)

Key = tuple[str, str, int]


class Replanner:
    """The questions that are open."""

    def __init__(
        self,
        bus: Bus,
        do: Callable[[Callable[[float], AnyEvent]], Awaitable[None]],
        admit: Callable[[Plan], Awaitable[tuple[str, ...]]],
    ) -> None:
        """`admit` lets a new plan through the gate; it returns why a person is to see it, or raises `Refusal`."""
        self._bus = bus
        self._do = do
        self._admit = admit
        self._asking: dict[Key, asyncio.Task[None]] = {}

    def ask(self, questions: Iterable[ReplanMission]) -> None:
        """Ask what is not being asked already."""
        for question in questions:
            key = (question.mission_id, question.task_id, question.number)
            if key not in self._asking:
                self._asking[key] = asyncio.create_task(self._answer(question), name=f"replan {key}")
                self._asking[key].add_done_callback(lambda _, key=key: self._asking.pop(key, None))

    async def close(self) -> None:
        """Ask no more; what has no answer is asked again by the next life."""
        asking = list(self._asking.values())
        for task in asking:
            task.cancel()
        await asyncio.gather(*asking, return_exceptions=True)

    async def _answer(self, question: ReplanMission) -> None:
        tasks, reasons, ask_because = await self._plan(question)
        _log.info(
            "replanned", mission_id=question.mission_id, task_id=question.task_id, reasons=[r.code for r in reasons]
        )
        while True:
            try:
                await self._do(
                    lambda at: MissionReplanned(
                        at=at,
                        mission_id=question.mission_id,
                        task_id=question.task_id,
                        number=question.number,
                        tasks=tasks,
                        reasons=reasons,
                        ask_because=ask_because,
                    )
                )
            except JournalUnavailableError:
                await asyncio.sleep(PAUSE_S)
            else:
                return

    async def _plan(
        self, question: ReplanMission
    ) -> tuple[tuple[PlanTask, ...] | None, tuple[Reason, ...], tuple[str, ...]]:
        give_up = time.monotonic() + GIVE_UP_S
        while True:
            try:
                reply: ReplanReply = await self._bus.ask(REPLAN, question, timeout_s=ANSWER_S)
                if reply.plan is None:
                    return None, reply.reasons, ()
                return reply.plan.tasks, (), await self._admit(reply.plan)
            except Refusal as refusal:
                return None, refusal.error.reasons, ()
            except (NoReplyError, RefusedError) as error:
                if time.monotonic() >= give_up:
                    return (
                        None,
                        (Reason(code="planner_silent", message=f"The planner gave no answer: {error}"[:1000]),),
                        (),
                    )
                await asyncio.sleep(PAUSE_S)
