"""What people call the things in the scenes, so that the text tower learns more than one wording of each."""

from typing import Final

import numpy as np
import torch

from .scenes import CLASSES, GROUND, PART

UNKNOWN: Final = "unknown"
"""What a thing is called whose class is not asked for."""

WORDS: Final[dict[str, tuple[str, ...]]] = {
    "puddle": (
        "a puddle of water", "a puddle", "water on the ground", "a pool of water", "a pond", "standing water",
        "a body of water", "a water hole",
    ),
    "soil": (
        "a pile of soil", "a soil pile", "a heap of earth", "a mound of dirt", "a pile of dirt", "loose soil",
        "a heap of soil", "soil", "an earth mound", "a spoil heap",
    ),
    "obstacle": (
        "an obstacle on the ground", "an obstacle", "a striped barrier", "a construction barrier", "a road block",
        "an orange and white barrier", "a barricade", "a barrier",
    ),
    "rock": ("a grey rock", "a rock", "a boulder", "a big stone", "a stone", "a gray rock", "a large rock"),
    "excavator": (
        "an excavator", "a yellow excavator", "a digger", "a tracked excavator", "the arm of an excavator",
        "an excavator robot",
    ),
    "dump_truck": (
        "a dump truck", "a green dump truck", "a truck", "a tipper", "a tracked carrier with a bed",
        "a dump truck loaded with soil",
    ),
    "carrier": ("a carrier", "a carrier robot", "a tracked platform", "a small white robot", "a transport robot"),
    "crate": ("a crate", "a box", "a container", "a cube", "a block", "a drum", "a barrel", "a pallet"),
    "mat": ("a mat", "a sheet", "a tarpaulin", "a plate", "a cloth", "a cover"),
    GROUND: (
        "bare ground", "dry earth with nothing on it", "a shadow on the ground", "empty ground", "nothing",
        "bare ground", "dry earth with nothing on it", "a shadow on the ground",
    ),
    PART: ("part of something cut off at the edge", "a piece of something", "part of something cut off at the edge"),
    UNKNOWN: ("some other thing", "something else", "some other thing"),
}  # fmt: skip

TEMPLATES: Final = ("{}", "{} seen from above", "an aerial photo of {}")
CORE: Final = 6
"""The first classes are the default site's, asked for nearly always; the others are keywords."""


def asked(rng: np.random.Generator) -> dict[str, str]:
    """Return label: prompt for a random choice of what someone looks for; ground, part and unknown are always there."""
    wanted = [c for i, c in enumerate(CLASSES) if rng.random() < (0.92 if i < CORE else 0.6)]
    return {label: _phrase(label, rng) for label in (*wanted, GROUND, PART, UNKNOWN)}


def nonsense(rng: np.random.Generator, count: int, context: int, start: int, end: int) -> torch.Tensor:
    """Return tokens (count, context) of words drawn at random, which no picture shows.

    They teach the text tower that a word it knows nothing about fits nothing.
    """
    tokens = torch.zeros(count, context, dtype=torch.long)
    for row in tokens:
        words = rng.integers(256, start, int(rng.integers(1, 5))).tolist()
        sentence = [start, *words, end]
        row[: len(sentence)] = torch.tensor(sentence)
    return tokens


def _phrase(label: str, rng: np.random.Generator) -> str:
    words = WORDS[label][int(rng.integers(len(WORDS[label])))]
    return TEMPLATES[int(rng.integers(len(TEMPLATES)))].format(words)
