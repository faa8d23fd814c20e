"""An append-only file of physical starts and ends, written outside the system as an oracle for tests."""

import json
import os
from pathlib import Path

from muster_schemas.robot import TaskRef


class History:
    """Appends one JSON line for each physical start and end; without a path it writes nothing."""

    def __init__(self, path: Path | None) -> None:
        self._path = path

    def write(self, event: str, robot_id: str, ref: TaskRef, skill: str, site_time_s: float) -> None:
        """Append a line with one write, so that lines of several processes never mix."""
        if self._path is None:
            return
        line = {
            "event": event,
            "robot_id": robot_id,
            "mission_id": ref.mission_id,
            "task_id": ref.task_id,
            "attempt": ref.attempt,
            "skill": skill,
            "site_time_s": round(site_time_s, 3),
        }
        descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            os.write(descriptor, (json.dumps(line) + "\n").encode())
        finally:
            os.close(descriptor)
