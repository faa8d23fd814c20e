"""Identifiers: the one pattern for everything that may become part of a key, a path or a URL."""

import re
import secrets
import time
from typing import Annotated

from pydantic import StringConstraints

ID_PATTERN = r"^[a-z0-9_-]{1,64}$"
_ID = re.compile(ID_PATTERN)

Id = Annotated[str, StringConstraints(pattern=ID_PATTERN)]
"""A site, robot, mission, task, object, camera, service or boot id."""


class InvalidIdError(ValueError):
    """A string that may not become part of a key; the message says which and what is allowed."""


def check_id(value: str, what: str = "id") -> str:
    """Return `value` unchanged if it is a valid id.

    Raises:
        InvalidIdError: it holds anything but a-z, 0-9, "_" and "-", is empty, or is longer than 64.

    """
    # fullmatch, because "$" also matches before a trailing newline
    if not _ID.fullmatch(value) or value.endswith("\n"):
        raise InvalidIdError(f"{what} {value[:80]!r} must be 1 to 64 characters of a-z, 0-9, '_' and '-'")
    return value


def new_id(prefix: str) -> str:
    """Return a fresh id such as `m-0f3k2…`, sortable by its time of birth (millisecond steps)."""
    return f"{prefix}-{time.time_ns() // 1_000_000:011x}{secrets.token_hex(4)}"


def new_boot_id() -> str:
    """Return the id of one life of a process; a later life sorts after an earlier one."""
    return new_id("boot")
