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
LEARNING: Final = 0.3
"""Weight of the newest measurement."""
FASTEST, SLOWEST = 0.02, 20.0


@dataclass(slots=True)
class Durations:
    """Estimates in the scheduler's own seconds. `pace` learns what a site second is worth here, and slow machines."""

    pace: dict[tuple[str, str], float] = field(default_factory=dict[tuple[str, str], float])
    """(verb, robot type) -> how long it took over how long it should have taken, smoothed."""
    overall: float | None = None
    expected: dict[TaskKey, float] = field(default_factory=dict[TaskKey, float])
    """Seconds from start to end that were said of tasks that have been planned."""

    def work_s(self, skill: Skill, robot_type: str) -> float:
        """Return how long a skill takes once its robots are where it is done."""
        return WORK_S.get(skill.verb, OTHER_WORK_S) * self.pace_of(skill.verb, robot_type)

    def pace_of(self, verb: str, robot_type: str) -> float:
        """Return what estimates of this verb have to be multiplied by."""
        return self.pace.get((verb, robot_type), self.overall or 1.0)

    def drive_s(self, metres: float, card: RobotCard) -> float:
        """Return how long a robot drives for so many metres."""
        if metres < 0.5:
            return 0.0
        return (metres / (SPEED_SHARE * card.max_speed_mps) + TURNING_S) * (self.overall or 1.0)

    def learn(self, verb: str, robot_type: str, expected_s: float, took_s: float) -> None:
        """Take in how long a task took that `expected_s` had been said of."""
        if expected_s <= 0:
            return
        key = verb, robot_type
        known = self.pace_of(verb, robot_type)
        seen = min(max(known * took_s / expected_s, FASTEST), SLOWEST)
        self.pace[key] = known + LEARNING * (seen - known)
        overall = self.overall or 1.0
        self.overall = overall + LEARNING / 4 * (seen - overall)
