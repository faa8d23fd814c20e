"""Whether the agent still has someone who could stop it, and a machine that answers. Wall clock; time comes in."""

from dataclasses import dataclass

SCHEDULER_GONE_S = 10.0
"""After this long without a scheduler or an own link the machine holds still until it is back."""
TELEMETRY_LATE_S = 2.0
TELEMETRY_GONE_S = 30.0
"""After this long without telemetry, while the own link is up, a skill under way has failed."""


@dataclass
class Watch:
    """What an agent knows of its links."""

    now: float
    """Monotonic seconds."""
    telemetry_at: float = float("-inf")
    scheduler_seen: bool = False
    scheduler_there: bool = False

    def __post_init__(self) -> None:
        self._scheduler_at = self._link_at = self._link_down_at = self.now

    def look(self, now: float, *, connected: bool) -> None:
        """Take note of the links as they are now."""
        self.now = now
        if connected:
            self._link_at = now
        else:
            self._link_down_at = now
        if self.scheduler_there:
            self.scheduler_seen = True
            self._scheduler_at = now

    @property
    def must_hold(self) -> str | None:
        """Why a skill under way must hold still now, or None.

        A site that has never had a scheduler, such as a bench, has nobody to miss.
        """
        if self.now - self._link_at > SCHEDULER_GONE_S:
            return f"no link to the site for {self.now - self._link_at:.0f} s: holding still"
        if self.scheduler_seen and self.now - self._scheduler_at > SCHEDULER_GONE_S:
            return f"no scheduler for {self.now - self._scheduler_at:.0f} s: holding still"
        return None

    @property
    def machine_is_late(self) -> bool:
        """Whether the machine should have been heard from by now."""
        return self.now - self.telemetry_at > TELEMETRY_LATE_S

    @property
    def machine_is_gone(self) -> bool:
        """Whether it has been silent for so long, with the link up, that its skill has failed."""
        return self.now - max(self.telemetry_at, self._link_down_at) > TELEMETRY_GONE_S
