"""A witness beside the journal that says how far it goes, so that a lost tail is noticed.

SQLite takes a damaged frame of its write-ahead log for the log's end: what was committed after it would be gone without
a word. So after each commit the last event's number and chained checksum go into a small file of their own. It is not
fsynced: a killed process leaves it whole in the page cache, and after a power cut it may be some commits behind, never
ahead; then it vouches for less, and nothing is said to be missing that is not.
"""

import os
import struct
import zlib
from pathlib import Path
from typing import Final, NamedTuple

_SLOT: Final = struct.Struct(">QII")
_SLOTS: Final = 2
_SPACING: Final = 512
"""One disk sector each, so that a torn write leaves the other slot whole."""


class Witnessed(NamedTuple):
    """The last event that was committed."""

    seq: int
    checksum: int


class Witness:
    """The file of one writer."""

    def __init__(self, path: Path) -> None:
        """Open or make it; raises OSError."""
        self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        self._writes = 0

    def read(self) -> Witnessed | None:
        """Return what it says, or None if it is new.

        Raises:
            ValueError: it is damaged.

        """
        found: list[Witnessed] = []
        blank = True
        for slot in range(_SLOTS):
            data = os.pread(self._file, _SLOT.size, slot * _SPACING)
            blank = blank and not any(data)
            if len(data) == _SLOT.size:
                seq, checksum, check = _SLOT.unpack(data)
                if check == _check(seq, checksum):
                    found.append(Witnessed(seq, checksum))
        if not found and not blank:
            raise ValueError("neither of its two entries is whole")
        return max(found, default=None)

    def write(self, seq: int, checksum: int) -> None:
        """Say that this event is the last; raises OSError."""
        slot = self._writes % _SLOTS
        self._writes += 1
        os.pwrite(self._file, _SLOT.pack(seq, checksum, _check(seq, checksum)), slot * _SPACING)

    def close(self) -> None:
        """Write no more."""
        os.close(self._file)


def _check(seq: int, checksum: int) -> int:
    return zlib.crc32(b"%d %d" % (seq, checksum))
