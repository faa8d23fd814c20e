"""From one instruction to one plan that the gate lets through: draft, check, repair at most twice, or say why not.

It knows nothing of the bus or of HTTP, so the service, a dry run and the offline command run the same code.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Collection, Sequence
from contextlib import AbstractAsyncContextManager, nullcontext
from dataclasses import dataclass
from typing import Protocol

from muster_schemas.gate import check_plan, unknown_objects
from muster_schemas.mission import Reason
from muster_schemas.plan import Plan

from .errors import AnswerError, ModelBusyError, PlanningError, ServerMissingError
from .llm import Feedback, PlanDraft, PlanningModel, PlanRequest
from .surroundings import Surroundings

ATTEMPTS = 3
"""One draft and two repairs."""

MAX_REASONS = 20

SERVER_RETRY_PAUSE_S = 1.0
"""Before a server that was not there, or that has too much to do and does not say how long, is asked once more."""


class Scene(Protocol):
    """Where a plan is to run: the live site, or a site's file."""

    def now(self) -> Surroundings:
        """Return the robots and objects that are there now."""
        ...

    async def look_for(self, names: Collection[str]) -> None:
        """Have the cameras look for objects that the map lacks; returns once they are there or the wait is over."""
        ...


@dataclass(frozen=True)
class Limits:
    """What one mission's planning may cost."""

    time_s: float = 120.0
    """Of model time over all attempts; waiting for other missions does not count."""
    tokens: int = 60_000
    """In and out, over all attempts."""
    answer_tokens: int = 4_096
    """Of one answer."""


@dataclass(frozen=True)
class Outcome:
    """How planning ended: with a plan, or with the reasons why there is none."""

    plan: Plan | None
    reasons: tuple[Reason, ...] = ()
    failure: PlanningError | None = None
    """The model's error, if that and not the instruction is why there is no plan."""
    attempts: int = 0
    model_s: float = 0.0
    tokens: int = 0


Accept = Callable[[Plan], Awaitable[Sequence[Reason]]]
"""The last word on a plan that passed the gate here: the scheduler's reasons against it, or none."""

TakeTurn = Callable[[], AbstractAsyncContextManager[object]]
"""Waits until the model is free and this mission's turn has come; held for one call."""


async def _accept_all(_plan: Plan) -> Sequence[Reason]:
    return ()


async def draft_plan(
    text: str,
    model: PlanningModel,
    scene: Scene,
    *,
    limits: Limits = Limits(),
    accept: Accept = _accept_all,
    take_turn: TakeTurn = nullcontext,
    background: str | None = None,
) -> Outcome:
    """Return a plan for the instruction that passed the gate and `accept`, or the reasons why there is none.

    Only cancellation and faults of this program are raised; a model's errors come back as reasons.
    """
    spent = _Spent(limits)
    feedback: Feedback | None = None
    reasons: Sequence[Reason] = ()
    failure: PlanningError | None = None
    await scene.look_for(scene.now().to_look_for(text))
    absent = scene.now().absent(text)
    if absent:
        return spent.end(reasons=absent)
    while spent.attempts < ATTEMPTS and not spent.over:
        surroundings = scene.now()
        request = surroundings.request(
            text, feedback, timeout_s=spent.time_left_s, max_tokens=spent.answer_tokens, background=background
        )
        try:
            async with take_turn():
                draft = await spent.call(model, request)
            failure = None
        except (ServerMissingError, ModelBusyError) as error:
            failure, reasons = error, [Reason(code=error.code, message=str(error)[:1000])]
            if not spent.may_wait(error):
                return spent.end(reasons=reasons, failure=failure)
            await asyncio.sleep(spent.pause_s)
            continue
        except AnswerError as error:
            failure, reasons = error, [Reason(code=error.code, message=str(error)[:1000])]
            feedback = Feedback(reasons=tuple(reasons), raw=error.raw)
            continue
        except PlanningError as error:
            return spent.end(reasons=[Reason(code=error.code, message=str(error)[:1000])], failure=error)
        if draft.plan is None:
            return spent.end(reasons=[Reason(code="refused", message=(draft.refusal or "")[:1000])])
        reasons = await _reasons_against(draft.plan, scene) or await accept(draft.plan)
        if not reasons:
            return spent.end(plan=draft.plan)
        feedback = Feedback(reasons=tuple(reasons), raw=draft.raw, plan=draft.plan)
    if spent.over:
        message = (
            f"Planning this used up what one mission may cost ({limits.time_s:g} s of model time, {limits.tokens} "
            "tokens). Say it in fewer words, or as several instructions."
        )
        reasons = [Reason(code="planning_budget", message=message), *reasons]
    return spent.end(reasons=reasons, failure=failure)


async def _reasons_against(plan: Plan, scene: Scene) -> list[Reason]:
    """Return the gate's reasons, after the cameras have looked for objects that the map lacks."""
    there = scene.now()
    reasons = check_plan(plan, there.roster, there.objects, there.catalogue)
    missing = unknown_objects(reasons, plan, there.objects)
    if not missing:
        return reasons
    await scene.look_for(missing)
    there = scene.now()
    return check_plan(plan, there.roster, there.objects, there.catalogue)


class _Spent:
    """Counts what one mission's planning has cost."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self.attempts = 0
        self.pause_s = 0.0
        """How long the pause before the next attempt is."""
        self._model_s = 0.0
        self._tokens = 0
        self._waited = False

    def may_wait(self, error: ServerMissingError | ModelBusyError) -> bool:
        """Return whether to ask the server again after a pause: once, and if the pause fits into the time."""
        asked = error.retry_after_s if isinstance(error, ModelBusyError) else None
        self.pause_s = SERVER_RETRY_PAUSE_S if asked is None else asked
        if self._waited or self.pause_s >= self.time_left_s:
            return False
        self._waited = True
        self._model_s += self.pause_s
        return True

    @property
    def time_left_s(self) -> float:
        return self._limits.time_s - self._model_s

    @property
    def answer_tokens(self) -> int:
        return max(1, min(self._limits.answer_tokens, self._limits.tokens - self._tokens))

    @property
    def over(self) -> bool:
        return self.time_left_s <= 0 or self._tokens >= self._limits.tokens

    async def call(self, model: PlanningModel, request: PlanRequest) -> PlanDraft:
        self.attempts += 1
        begin = time.monotonic()
        try:
            draft = await model.plan(request)
        except AnswerError as error:
            self._tokens += error.tokens_in + error.tokens_out
            raise
        finally:
            self._model_s += time.monotonic() - begin
        self._tokens += draft.tokens_in + draft.tokens_out
        return draft

    def end(
        self, *, plan: Plan | None = None, reasons: Sequence[Reason] = (), failure: PlanningError | None = None
    ) -> Outcome:
        unique = {(r.code, r.task, r.message): r for r in reasons}
        return Outcome(
            plan=plan,
            reasons=tuple(unique.values())[:MAX_REASONS],
            failure=failure,
            attempts=self.attempts,
            model_s=self._model_s,
            tokens=self._tokens,
        )
