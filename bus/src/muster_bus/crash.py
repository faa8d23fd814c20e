"""Named places at which a test may end the process as a power cut would. Off unless `MUSTER_CRASH_AT` says so.

A process passes its places in one order: `commit` and `committed` around each write, `send` before each message that
depends on one, `sent` after the last of a batch, and the places that a service names itself.
"""

import os
import re
import signal
from collections.abc import Callable

CRASH_AT = re.compile(r"(?:([a-z_]{1,32}):)?([1-9][0-9]{0,6})")
"""`7`: at the seventh place passed; `committed:2`: at the second passing of the place `committed`."""

Passing = Callable[[str], None]
"""Told the name of a place when the process gets there."""

_passing: Passing | None = None


def point(name: str) -> None:
    """Say that the process is at the place `name`."""
    if _passing is not None:
        _passing(name)


def on_passing(passing: Passing | None) -> None:
    """Have someone told of every place from now on; None: nobody."""
    global _passing  # noqa: PLW0603  (one process has one)
    _passing = passing


def kill_at(where: str) -> Passing:
    """Return what kills this process by SIGKILL at a place.

    Args:
        where: see `CRASH_AT`.

    """
    match = CRASH_AT.fullmatch(where)
    if match is None:
        raise ValueError(f"{where!r} is no place to crash at; write it like 7 or committed:2")
    wanted, left = match[1], int(match[2])

    def passing(name: str) -> None:
        nonlocal left
        if wanted in (None, name):
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)

    return passing
