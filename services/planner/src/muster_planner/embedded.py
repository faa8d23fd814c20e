"""The `embedded` adapter: this project's own small model inside this process.

It reads the instruction beside the site and writes the plan by pointing at what it read (`pointer/`), so it can name
only what is there. Calls run one at a time on a thread of their own, so the event loop stays free.
"""

import asyncio
import threading
import time
from collections.abc import AsyncGenerator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from muster_schemas.skills import ObjectNeed

from .embedded_files import model_folder
from .errors import ModelTimeoutError, TruncatedAnswerError, UnusableAnswerError
from .llm import PlanDraft, PlanRequest
from .plan_language import PlanLanguageError, Refusal, decode
from .pointer.network import Network
from .pointer.reading import Reader, TooLongError
from .pointer.scene import Scene, SceneKind
from .pointer.search import Found, StoppedError, search
from .refusals import explained
from .robot_order import one_thing_at_a_time
from .second_look import ranked
from .short_names import SiteNames, said_in_words

THREADS = 2


@dataclass(frozen=True)
class _Answers:
    found: Sequence[Found]
    tokens_in: int
    choices: int


class EmbeddedModel:
    """The loaded model; `plan` may be called from several tasks, the calls queue."""

    def __init__(self, network: Network, reader: Reader, worker: ThreadPoolExecutor) -> None:
        self._network, self._reader = network, reader
        self._worker = worker

    async def plan(self, request: PlanRequest) -> PlanDraft:
        """Return a draft; see `llm.PlanningModel`."""
        begin = time.monotonic()
        names = SiteNames(request.roster, request.objects, request.catalogue, request.letters)
        stop = threading.Event()
        call = asyncio.get_running_loop().run_in_executor(self._worker, self._answers, request, names, stop)
        try:
            async with asyncio.timeout(request.timeout_s):
                answers = await asyncio.shield(call)
        except TimeoutError as error:
            await _ended(call, stop)
            message = f"The embedded model did not answer within {request.timeout_s:.0f} s. Say it shorter."
            raise ModelTimeoutError(message) from error
        except TooLongError as error:
            message = "The instruction is longer than the embedded model can read. Send it as several."
            raise TruncatedAnswerError(message) from error
        except asyncio.CancelledError:
            await _ended(call, stop)
            raise
        return _draft(answers, request, names, time.monotonic() - begin)

    def _answers(self, request: PlanRequest, names: SiteNames, stop: threading.Event) -> _Answers:
        if stop.is_set():
            raise StoppedError
        scene = scene_of(names)
        reading = self._reader.read(said_in_words(request.text, names), scene)
        memory = self._network.read(reading, scene)
        found = search(self._network, memory, scene, most=request.max_tokens, stop=stop)
        found = ranked(found, request.text, names)
        return _Answers(found, len(reading.ids), max((f.choices for f in found), default=request.max_tokens))


async def _ended(call: asyncio.Future[_Answers], stop: threading.Event) -> None:
    """Make a running search end at its next choice, and wait for that."""
    stop.set()
    await asyncio.wait([call])


def scene_of(names: SiteNames) -> Scene:
    """Return the site as the model reads it."""
    kinds = (SceneKind(k.words, k.letter, tuple(k.robots), k.verbs) for k in names.kinds)
    skills = list(names.catalogue)
    return Scene(
        tuple(kinds),
        tuple(s.verb for s in names.common),
        names.objects,
        placed=frozenset(s.verb for s in skills if s.objects is ObjectNeed.REQUIRED),
        placeless=frozenset(s.verb for s in skills if s.objects is ObjectNeed.NONE),
    )


def _draft(answers: _Answers, request: PlanRequest, names: SiteNames, latency_s: float) -> PlanDraft:
    """Return the likeliest answer; for a repair, the likeliest that is not the one refused before."""
    refused = request.feedback.raw if request.feedback else None
    raw = next((r for r in map(_raw, answers.found) if r != refused), None)
    tokens_in, tokens_out = answers.tokens_in, answers.choices
    if raw is None:
        message = "The instruction needs a longer plan than the embedded model can write. Send it as several."
        raise TruncatedAnswerError(message, raw=refused or "", tokens_in=tokens_in, tokens_out=tokens_out)
    try:
        answer = decode(raw, names)
    except PlanLanguageError as error:
        message = f"The embedded model's answer is no plan: {error}"[:900]
        raise UnusableAnswerError(message, raw=raw, tokens_in=tokens_in, tokens_out=tokens_out) from error
    refusal = explained(answer.reason, names) if isinstance(answer, Refusal) else None
    return PlanDraft(
        plan=None if isinstance(answer, Refusal) else one_thing_at_a_time(answer, names),
        refusal=refusal,
        raw=raw,
        latency_s=latency_s,
        tokens_in=tokens_in,
        tokens_out=tokens_out,
    )


def _raw(found: Found) -> str:
    writing = found.writing
    return f"refuse {writing.refusal}" if writing.refusal else writing.said()


@asynccontextmanager
async def open_embedded(*, threads: int = THREADS, folder: Path | None = None) -> AsyncGenerator[EmbeddedModel]:
    """Load the model (a second or less), and free it at the end.

    Raises:
        ModelMissingError: one of its files is not there.

    """
    files = folder or model_folder()
    worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="embedded-model")
    try:
        network = await asyncio.get_running_loop().run_in_executor(worker, Network, files, threads)
        yield EmbeddedModel(network, Reader(files / "tokenizer.json"), worker)
    finally:
        await asyncio.to_thread(worker.shutdown)
