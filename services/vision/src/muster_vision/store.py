"""What must survive a restart: names, numbers and places of objects, in one JSON file that is replaced whole."""

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

import structlog
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .tracker import Gone, Sighting, Track, Tracker

_log = structlog.stdlib.get_logger(__name__)

_FORMAT = 1


class _Kept(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    name: str
    looks: int
    last: Sighting
    measured: list[Sighting]
    seen_at: float


class _SavedMap(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    format: int = Field(default=_FORMAT, ge=_FORMAT, le=_FORMAT)
    site: str
    numbered: bool
    highest: dict[str, int]
    objects: list[_Kept]
    gone: list[Gone]


class MapFile:
    """The file of one site in `data_dir`."""

    def __init__(self, data_dir: Path, site: str) -> None:
        self.path = data_dir / f"vision-{site}.json"
        self._site = site
        self._written = b""

    def load(self, loose: Iterable[str] = ()) -> Tracker:
        """Return the tracker as it was saved; a new one if there is no file or it cannot be used (which is logged)."""
        tracker = Tracker(loose)
        try:
            saved = _SavedMap.model_validate_json(self.path.read_bytes())
        except FileNotFoundError:
            return tracker
        except (OSError, ValidationError) as error:
            aside = self.path.with_suffix(".unreadable")
            _log.error("map_file_unreadable", path=str(self.path), kept_as=str(aside), error=str(error)[:500])
            if self.path.exists():
                self.path.replace(aside)
            return tracker
        tracker.numbered, tracker.highest, tracker.gone = saved.numbered, dict(saved.highest), list(saved.gone)
        tracker.tracks = [
            Track(
                k.last, name=k.name, looks=k.looks, measured=k.measured, seen_at=k.seen_at, confidence=k.last.confidence
            )
            for k in saved.objects
        ]
        return tracker

    def save(self, tracker: Tracker) -> None:
        """Write the tracker's names and places if they changed; a crash leaves the old file or the new one."""
        saved = _SavedMap(
            site=self._site,
            numbered=tracker.numbered,
            highest=tracker.highest,
            objects=[
                _Kept(name=t.name, looks=t.looks, last=t.last, measured=t.measured, seen_at=t.seen_at)
                for t in tracker.tracks
                if t.name is not None
            ],
            gone=tracker.gone,
        )
        # when it was last seen, and how often, is not worth a write
        same = saved.model_copy(
            update={"objects": [k.model_copy(update={"looks": 0, "seen_at": 0.0}) for k in saved.objects]}
        ).model_dump_json()
        if same.encode() == self._written:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=self.path.parent, prefix=self.path.name)
        with os.fdopen(handle, "wb") as file:
            file.write(saved.model_dump_json(indent=1).encode())
            file.flush()
            os.fsync(file.fileno())
        Path(name).replace(self.path)
        self._written = same.encode()
