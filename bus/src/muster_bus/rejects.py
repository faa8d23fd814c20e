"""Counts and logs what is turned away, without letting a flood of it fill the log."""

import time
from collections import Counter

import structlog

_log = structlog.stdlib.get_logger(__name__)
_EVERY_S = 1.0


class Rejects:
    """Messages turned away, by channel name; one log line a second and channel at most."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._logged: dict[str, tuple[float, int]] = {}

    def count(self, channel: str, key: str, reason: str) -> None:
        """Count one, and log it unless one of this channel was logged just now."""
        self.counts[channel] += 1
        at, logged = self._logged.get(channel, (-_EVERY_S, 0))
        now = time.monotonic()
        if now - at >= _EVERY_S:
            total = self.counts[channel]
            self._logged[channel] = (now, total)
            _log.warning("message_rejected", channel=channel, key=key[:300], reason=reason, more=total - logged - 1)
