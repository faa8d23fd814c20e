"""One look, from frames to the tracker's map. No bus, no clock of its own; runs in a worker thread."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import structlog
from muster_schemas.site import Site
from muster_schemas.world import CameraFrame

from .birdseye import BirdsEye, Grid
from .camera import FrameError
from .clip_model import ClipModel
from .detector import Detector
from .robots import Shadows, Stand, shadows
from .tracker import Place, Sighting, Track, Tracker
from .vocabulary import Vocabulary

MOST_CAMERAS: Final = 64
"""More than this many are not taken in: each costs a few megabytes."""

_log = structlog.stdlib.get_logger(__name__)


@dataclass(frozen=True)
class Frame:
    """What came over the bus."""

    meta: CameraFrame
    jpeg: bytes


class Pipeline:
    """The bird's-eye view, the detector and the tracker of one site."""

    def __init__(self, site: Site, model: ClipModel, tracker: Tracker) -> None:
        self.view = BirdsEye(Grid.over(site.bounds))
        self.tracker = tracker
        self.dropped = 0
        """Frames that could not be used."""
        self._detector = Detector(model, flat=site.vision.flat, loose=site.vision.loose)
        self._expected = frozenset(c.id for c in site.cameras)
        self._sightings: list[Sighting] = []
        self._last: tuple[tuple[Stand, ...], tuple[str, ...]] | None = None
        self._shadows: Shadows | None = None

    @property
    def complete(self) -> bool:
        """Whether every camera of the site's file has delivered."""
        return self._expected <= set(self.view.layers)

    def look(
        self,
        frames: Mapping[str, Frame],
        stands: tuple[Stand, ...],
        vocabulary: Vocabulary,
        *,
        settle: bool = False,
    ) -> bool:
        """Take in new frames, bring the tracker's map up to date, and return whether anything had to be computed.

        Args:
            frames: the newest one of each camera that delivered since the last look.
            stands: where robots stood when the frames were taken.
            vocabulary: what to look for.
            settle: do not wait for missing cameras any longer before the first numbering.

        """
        taken = [self._add(frame) for frame in frames.values()]
        changed = any(taken) | self.view.yield_stale()
        if not self.view.layers:
            return False
        situation = (stands, vocabulary.names)
        if changed or situation != self._last or self._shadows is None:
            self._shadows = shadows(self.view, stands)
            changed = True
        self._last = situation
        self._sightings = self._detector.look(self.view, vocabulary, self._shadows, changed=changed)
        hidden_by = self._shadows

        def judge(track: Track) -> Place:
            return self._detector.judge(self.view, hidden_by, track)

        newest = max(layer.taken_at for layer in self.view.layers.values())
        self.tracker.look(self._sightings, judge, complete=self.complete or settle, now=newest)
        return changed

    def _add(self, frame: Frame) -> bool:
        meta = frame.meta
        layers = self.view.layers
        try:
            if meta.camera_id not in layers and len(layers) >= MOST_CAMERAS:
                raise FrameError(f"there are {MOST_CAMERAS} cameras already")
            if not all(map(math.isfinite, (meta.cx_px, meta.cy_px, meta.x_m, meta.y_m, meta.z_m))):
                raise FrameError("its pose is not finite")
            return self.view.add(meta, frame.jpeg)
        except FrameError as error:
            self.dropped += 1
            # a broken camera would flood the log
            if self.dropped <= 10 or self.dropped % 100 == 0:
                _log.warning("frame_dropped", camera=meta.camera_id, seq=meta.seq, why=str(error), dropped=self.dropped)
            return False
