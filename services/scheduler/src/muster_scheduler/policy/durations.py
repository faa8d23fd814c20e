"""How long tasks take, as far as can be said beforehand: skill times, which are learned, and drives.

Only advice hangs on these numbers, never whether something may start, so a wrong one costs time and nothing else.
"""

from dataclasses import dataclass, field
from typing import Final

from muster_schemas.robot import RobotCard
from muster_schemas.skills import Skill

from muster_scheduler.core.queue import TaskKey

WORK_S: Final = {
    "dig": 20.0,
    "dump": 12.0,
    "load": 14.0,
    "tip": 12.0,
    "go": 2.0,
    "home": 2.0,
    "avoid": 1.0,
    "allow": 1.0,
}
"""Site seconds of each verb beside its driving, as the simulator's machines need them."""
OTHER_WORK_S: Final = 30.0
"""For a site's own skills, until one has been seen."""
TURNING_S: Final = 4.0
"""Turning on the spot at both ends of a drive."""
SPEED_SHARE: Final = 0.85
"""Mean speed of a drive over the machine's greatest."""
DRIVES: Final = ("go", "home")
"""Verbs that are little else than driving."""
LEARNING: Final = 0.3
"""Weight of the newest measurement."""
FASTEST, SLOWEST = 0.02, 20.0


@dataclass(slots=True)
class Durations:
    """Estimates in the scheduler's own seconds; what tasks really took corrects them.

    The ratios also take in what a site second is worth here (a simulator may run many times faster), detours around
    things, and slow machines.
    """

    pace: dict[tuple[str, str], float] = field(default_factory=dict[tuple[str, str], float])
    """(verb, robot type) -> seconds of its work over `WORK_S`, smoothed."""
    drive_pace: float = 1.0
    """Seconds of driving over those of the straight way, smoothed."""
    expected: dict[TaskKey, float] = field(default_factory=dict[TaskKey, float])
    """Seconds from start to end that were said of tasks that have been planned."""

    def work_s(self, skill: Skill, robot_type: str) -> float:
        """Return how long a skill takes once its robots are where it is done."""
        pace = self.pace.get((skill.verb, robot_type), self.drive_pace)
        return WORK_S.get(skill.verb, OTHER_WORK_S) * pace

    def drive_s(self, metres: float, card: RobotCard) -> float:
        """Return how long a robot drives for so many metres."""
        if metres < 0.5:
            return 0.0
        return (metres / (SPEED_SHARE * card.max_speed_mps) + TURNING_S) * self.drive_pace

    def learn(self, verb: str, robot_type: str, expected_s: float, took_s: float) -> None:
        """Take in how long a task took that `expected_s` had been said of."""
        if expected_s <= 0:
            return
        ratio = took_s / expected_s
        if verb in DRIVES:
            self.drive_pace = _learned(self.drive_pace, ratio)
        else:
            key = verb, robot_type
            self.pace[key] = _learned(self.pace.get(key, self.drive_pace), ratio)


def _learned(known: float, ratio: float) -> float:
    seen = min(max(known * ratio, FASTEST), SLOWEST)
    return known + LEARNING * (seen - known)
