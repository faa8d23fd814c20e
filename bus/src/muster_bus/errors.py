"""What can go wrong on the bus, by who must act.

    BusError
    ├── NoReplyError          ask(): nobody answered in time; whether it ran is not known, so ask what became of it
    ├── RefusedError          ask(): the other side said no; its `error` says why, nothing has changed
    ├── TooBigError           publish(): the message is larger than its channel allows; send less
    ├── WrongMessageError     publish(): not the channel's model, or other ids than the key's; the caller is wrong
    └── AlreadyRunningError   start: the same service or robot is alive elsewhere; stop that one first

    Refusal                   raised *by* a handler of serve() to say no; the asker gets it as RefusedError

Messages that come in malformed raise nothing: they are counted in `Bus.rejected` and logged.
"""

from muster_schemas.rpc import ErrorCode, ErrorReply


class BusError(Exception):
    """The root of what the bus raises."""


class NoReplyError(BusError):
    """Nobody answered in time. It may have run all the same."""


class RefusedError(BusError):
    """The other side refused; nothing has changed."""

    def __init__(self, error: ErrorReply) -> None:
        super().__init__(f"{error.code}: {error.message}")
        self.error = error


class TooBigError(BusError, ValueError):
    """A message larger than its channel allows."""


class WrongMessageError(BusError, TypeError):
    """A message that does not belong on the channel or key that it was to go to."""


class AlreadyRunningError(BusError):
    """Another process with the same identity is alive."""


class Refusal(Exception):  # noqa: N818  (an answer, not an error of this process)
    """A handler's answer "no"."""

    def __init__(self, error: ErrorReply) -> None:
        super().__init__(error.message)
        self.error = error

    @classmethod
    def because(cls, code: ErrorCode, message: str) -> "Refusal":
        """Return a refusal without further reasons; a long message is cut."""
        return cls(ErrorReply(code=code, message=message[:2000]))
