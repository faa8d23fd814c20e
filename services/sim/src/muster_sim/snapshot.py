"""The state of a world on disk, so that a simulator that crashed goes on where it was: a real site does not start over.

A simulator that is asked to end removes its snapshot, so the next one begins with the site as its file says. One older
than `FRESH_S` is left alone for the same reason: whoever starts a site the day after a power cut wants a new one.
"""

import hashlib
import time
from pathlib import Path
from typing import Final

import structlog
from muster_schemas.base import Message, Pose
from muster_schemas.ids import Id
from muster_schemas.robot import Load
from muster_schemas.site import Site
from pydantic import Field, ValidationError

FRESH_S: Final = 60.0

_log = structlog.stdlib.get_logger(__name__)


class MachineState(Message):
    """A machine at rest."""

    pose: Pose
    joints: dict[str, float]
    load: Load


class BodyState(Message):
    """A thing, on the ground or carried."""

    pose: Pose
    carrier: Id | None


class HeapState(Message):
    """Soil on the ground."""

    number: int = Field(ge=0)
    x: float
    y: float
    soil_m3: float = Field(gt=0)
    slope: float = Field(gt=0)
    fill: float = Field(gt=0)
    pile: Id | None


class Snapshot(Message):
    """Everything that a world needs to go on."""

    site: str = Field(description="digest of the site and the seed that it belongs to")
    steps: int = Field(ge=0)
    machines: dict[Id, MachineState]
    bodies: dict[Id, BodyState]
    heaps: tuple[HeapState, ...]
    dug_m3: float = Field(ge=0)
    robot_contacts: int = Field(ge=0)


def digest(site: Site, seed: int) -> str:
    """Return what tells one site's file (and seed) from another."""
    return hashlib.sha256(site.model_dump_json(by_alias=True).encode() + str(seed).encode()).hexdigest()


class SnapshotFile:
    """One file for each site's name, replaced as a whole so that a kill at any moment leaves a valid one."""

    def __init__(self, data_dir: Path, site: Site) -> None:
        self._path = data_dir / "sim" / f"{site.name}.json"

    def load(self, site_digest: str) -> Snapshot | None:
        """Return the snapshot of a simulator that did not end by itself a moment ago, or None."""
        try:
            if time.time() - self._path.stat().st_mtime > FRESH_S:
                return None
            snapshot = Snapshot.model_validate_json(self._path.read_bytes())
        except FileNotFoundError:
            return None
        except (OSError, ValidationError) as error:
            _log.warning("snapshot_unusable", path=str(self._path), why=str(error)[:400])
            return None
        return snapshot if snapshot.site == site_digest else None

    def save(self, snapshot: Snapshot) -> None:
        """Replace the file. A disk that is full does not stop the site; it is logged."""
        new = self._path.with_suffix(".new")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            new.write_bytes(snapshot.to_json())
            new.replace(self._path)
        except OSError as error:
            _log.error("snapshot_not_kept", path=str(self._path), why=str(error))

    def remove(self) -> None:
        """Forget it: the simulator ends by itself."""
        self._path.unlink(missing_ok=True)
