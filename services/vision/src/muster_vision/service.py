"""The service: frames, robots and keywords come in over the bus, the object map goes out."""

import asyncio
import resource
import sys
import time
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import structlog
from muster_bus import Bus
from muster_schemas.channels import CAMERA_IMAGE, KEYWORDS, OBJECT, ROBOT_STATE
from muster_schemas.site import Site

from .object_map import ObjectMap
from .pipeline import Frame, Pipeline
from .robots import RobotWatch, Stand
from .store import MapFile
from .vocabulary import Vocabulary, Wishes

LOOK_PERIOD_S: Final = 1.0
"""Looks at a changing site start at most this often, so that a busy site leaves the processor to others."""
REPORT_PERIOD_S: Final = 60.0
PATIENCE_S: Final = 20.0
"""The first numbering waits this long for cameras of the site's file that do not deliver."""
AHEAD_S: Final = 60.0
"""A frame from farther in the future than this has a wrong clock."""

_log = structlog.stdlib.get_logger(__name__)


@dataclass(frozen=True)
class _Look:
    """Everything that one look works on, as it was when the look began."""

    frames: dict[str, Frame]
    stands: tuple[Stand, ...]
    vocabulary: Vocabulary
    settle: bool


class Vision:
    """Runs until told to stop.

    Args:
        bus: connected.
        site: whose objects are mapped.
        pipeline: does the looking, in a thread of its own.
        file: keeps names across restarts.

    """

    def __init__(self, bus: Bus, site: Site, pipeline: Pipeline, file: MapFile) -> None:
        self._bus = bus
        self._pipeline = pipeline
        self._file = file
        self._map = ObjectMap(
            publish=lambda m: bus.publish(OBJECT, m, object_name=m.name),
            retract=lambda name: bus.retract(OBJECT, object_name=name),
        )
        self._site = site
        self._wishes = Wishes(site)
        self._robots = RobotWatch(site)
        self._frames: dict[str, Frame] = {}
        self._wake = asyncio.Event()
        self._urgent = False
        self._started = 0.0
        self._slowest_s = 0.0
        self._words: tuple[str, ...] = ()

    async def run(self, stop: asyncio.Event) -> None:
        """Map until `stop` is set; what is known from before is published at once."""
        self._map.update(self._pipeline.tracker, time.monotonic())
        parts: tuple[Coroutine[Any, Any, None], ...] = (self._film(), self._follow_robots(), self._hear(), self._look())
        working = [asyncio.create_task(part) for part in parts]
        stopping = asyncio.create_task(stop.wait(), name="stop")
        try:
            done, _ = await asyncio.wait((*working, stopping), return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            stopping.cancel()
            for task in working:
                task.cancel()
            await asyncio.gather(*working, return_exceptions=True)

    async def _film(self) -> None:
        async with self._bus.subscribe(CAMERA_IMAGE) as images:
            async for received in images:
                meta = received.message
                if meta is None:
                    continue
                if meta.taken_at > time.time() + AHEAD_S:
                    _log.warning("frame_dropped", camera=meta.camera_id, why="it is from the future; set its clock")
                    continue
                self._frames[received.ids["camera_id"]] = Frame(meta, received.payload)
                self._wake.set()

    async def _follow_robots(self) -> None:
        async with self._bus.subscribe(ROBOT_STATE) as states:
            async for received in states:
                if received.message is not None:
                    self._robots.take(received.message)

    async def _hear(self) -> None:
        async with self._bus.subscribe(KEYWORDS) as wishes:
            async for received in wishes:
                if received.message is not None:
                    wish = received.message
                    self._wishes.want(wish.keywords, time.monotonic() + wish.for_s)
                    _log.info("keywords", keywords=list(wish.keywords), asked_by=wish.asked_by, for_s=wish.for_s)
                    self._urgent = True
                    self._wake.set()

    async def _look(self) -> None:
        loop = asyncio.get_running_loop()
        next_look = reported = 0.0
        with ThreadPoolExecutor(1, thread_name_prefix="look") as pool:
            while True:
                await self._woken()
                while not self._urgent and (wait_s := next_look - time.monotonic()) > 0:
                    self._wake.clear()
                    await self._woken(wait_s)
                frames, self._frames = self._frames, {}
                self._wake.clear()
                self._urgent = False
                begin = time.monotonic()
                look = self._prepare(frames, begin)
                computed = look is not None and await loop.run_in_executor(pool, self._work, look)
                spent = time.monotonic() - begin
                self._map.update(self._pipeline.tracker, time.monotonic())
                if computed:
                    next_look = begin + max(LOOK_PERIOD_S, 2 * spent)
                    self._slowest_s = max(self._slowest_s, spent)
                if begin - reported >= REPORT_PERIOD_S:
                    reported = begin
                    self._report()

    async def _woken(self, at_most_s: float = 1.0) -> None:
        """Wait for something to do, at most a second: refreshes are due even when no camera delivers."""
        try:
            async with asyncio.timeout(at_most_s):
                await self._wake.wait()
        except TimeoutError:
            return

    def _prepare(self, frames: dict[str, Frame], now: float) -> _Look | None:
        """Put together what a look needs, or None if it would show nothing new.

        The worker gets copies, because messages go on changing robots and wishes; the tracker is this loop's to read
        only while no look is under way.
        """
        if frames and not self._started:
            self._started = now
        vocabulary = self._wishes.vocabulary(now, sorted({t.object_class for t in self._pipeline.tracker.named}))
        if not frames and vocabulary.names == self._words:
            return None
        self._words = vocabulary.names
        stands = self._robots.stands(f.meta.taken_at for f in frames.values())
        return _Look(frames, stands, vocabulary, settle=bool(self._started) and now - self._started > PATIENCE_S)

    def _work(self, look: _Look) -> bool:
        """Look and save, in the worker thread: of this object, only pipeline and file may be touched."""
        computed = self._pipeline.look(look.frames, look.stands, look.vocabulary, settle=look.settle)
        self._file.save(self._pipeline.tracker)
        return computed

    def _report(self) -> None:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
        _log.info(
            "state",
            objects=len(self._pipeline.tracker.named),
            cameras=len(self._pipeline.view.layers),
            frames_dropped=self._pipeline.dropped,
            slowest_look_s=round(self._slowest_s, 3),
            peak_memory_mb=round(peak / 2**20),
        )
        self._slowest_s = 0.0
