"""Site time against the wall clock: how many steps are due, and how fast it really goes. Pure; time comes in."""

from collections import deque
from typing import Final

CATCH_UP: Final = 2.0
"""After a delay site time passes at most this many times faster than asked ..."""
DEBT_S: Final = 0.5
"""... and of a delay no more than this is made up for, in wall time. The rest is lost: the site was paused."""
WINDOW_S: Final = 2.0
"""The achieved factor is that of this much wall time."""


class Pace:
    """Deals out steps.

    Args:
        factor: site seconds wanted a second.
        step_s: site time of a step.
        now_s: a monotonic clock's reading.

    """

    def __init__(self, factor: float, step_s: float, now_s: float) -> None:
        self.factor = factor
        self._step_s = step_s
        self._last_s = now_s
        self._debt_s = 0.0
        self._done: deque[tuple[float, int]] = deque([(now_s, 0)])
        self._steps = 0

    def due(self, now_s: float, bite_s: float) -> int:
        """Return how many steps to do now, so that the next look, `bite_s` later, finds site time on time.

        A long delay comes back in bites of at most `CATCH_UP` times the normal size, so that commands get through in
        between.
        """
        self._debt_s = min(self._debt_s + now_s - self._last_s, DEBT_S)
        self._last_s = now_s
        most = max(1, round(CATCH_UP * bite_s * self.factor / self._step_s))
        steps = min(most, int(self._debt_s * self.factor / self._step_s + 1e-9))
        self._debt_s -= steps * self._step_s / self.factor
        self._steps += steps
        self._done.append((now_s, self._steps))
        while len(self._done) > 2 and self._done[1][0] <= now_s - WINDOW_S:
            self._done.popleft()
        return steps

    @property
    def achieved_factor(self) -> float:
        """Site seconds passed a second, lately."""
        (begin_s, before), (end_s, after) = self._done[0], self._done[-1]
        return (after - before) * self._step_s / (end_s - begin_s) if end_s > begin_s else 0.0
