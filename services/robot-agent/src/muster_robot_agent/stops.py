"""What an agent knows of stops: the newest order, kept in its journal, so that it holds over restarts. Pure.

An order with a higher number replaces one with a lower; any other is answered with what holds.
"""

from dataclasses import dataclass

from muster_schemas.stops import StopRequest


@dataclass(frozen=True)
class StopBook:
    """The newest stop order that this robot has seen; number 0 before the first."""

    number: int = 0
    stopped: bool = False
    was_busy: bool = False
    """Whether a skill was under way when it came."""

    @classmethod
    def kept(cls, number: float | None) -> "StopBook":
        """Return the book as `kept_number` wrote it; None: nothing was ever written."""
        return cls() if number is None else cls(number=int(abs(number)), stopped=number > 0)

    @property
    def kept_number(self) -> float:
        """Both facts in one number, so that they are committed together: negative once released."""
        return float(self.number if self.stopped else -self.number)

    def after(self, request: StopRequest, *, busy: bool) -> "StopBook":
        """Return the book after a request; the same book if it is no news."""
        if request.number <= self.number:
            return self
        return StopBook(request.number, request.stopped, was_busy=busy)
