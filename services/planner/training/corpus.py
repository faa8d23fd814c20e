"""The hand-written cases in `data/`, split into those to train on and the held-out voices."""

import json
from pathlib import Path

from .augment import Case
from .notation import parse

DATA = Path(__file__).parent / "data"
HELD_OUT = ("voice7", "voice16")
"""Voices that no run trains on: what they score estimates how unknown people fare."""


def read(path: Path) -> list[Case]:
    """Return the cases of one voice."""
    rows = (json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.strip())
    return [Case(r["text"], parse(r["plan"]), level=r["level"]) for r in rows]


def training() -> list[Case]:
    """Return all cases that may be trained on."""
    return [c for p in sorted(DATA.glob("*.jsonl")) if p.stem not in HELD_OUT for c in read(p)]


def held_out() -> list[Case]:
    """Return the held-out voices' cases."""
    return [c for name in HELD_OUT for c in read(DATA / f"{name}.jsonl")]
