"""Surface pictures (RGB, uint8) of ground, soil, water and barriers; different for every seed, alike in kind."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Picture = NDArray[np.uint8]


def ground(rng: np.random.Generator, size: int = 1024) -> Picture:
    """Return dry trodden earth: patches of several sizes and fine grain."""
    base = np.array([186, 168, 138]) + rng.normal(0, 5, 3)
    shade = 7 * _patches(rng, size, 6) + 6 * _patches(rng, size, 24) + 6 * _patches(rng, size, 128)
    grain = rng.normal(0, 5, (size, size))
    warmth = 3 * _patches(rng, size, 10)
    tint = np.stack([warmth, np.zeros_like(warmth), -warmth], axis=-1)
    return _picture(base + (shade + grain)[..., None] + tint)


def soil(rng: np.random.Generator, size: int = 128) -> Picture:
    """Return dark moist soil with clods."""
    base = np.array([112, 76, 46]) + rng.normal(0, 5, 3)
    return _picture(base + (14 * _patches(rng, size, 24) + rng.normal(0, 10, (size, size)))[..., None])


def water(rng: np.random.Generator, size: int = 128) -> Picture:
    """Return shallow water under an open sky: bluish, brighter patches, a darker rim."""
    base = np.array([74, 122, 168]) + rng.normal(0, 6, 3)
    y, x = np.mgrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j]
    rim = np.clip((np.hypot(x, y) - 0.72) / 0.2, 0, 1)[..., None]
    sheen = (14 * _patches(rng, size, 5) + 4 * _patches(rng, size, 40))[..., None]
    return _picture((base + sheen) * (1 - rim) + np.array([104, 104, 100]) * rim)


def stone(rng: np.random.Generator, size: int = 64) -> Picture:
    """Return grey weathered stone."""
    base = np.array([134, 134, 138]) + rng.normal(0, 6)
    return _picture(base + (12 * _patches(rng, size, 8) + rng.normal(0, 7, (size, size)))[..., None])


def stripes(rng: np.random.Generator, size: int = 64) -> Picture:
    """Return the slanted orange and white stripes of a construction barrier."""
    y, x = np.mgrid[0:size, 0:size]
    orange = ((x + y) / size * 3 + rng.uniform(0, 1)) % 1 < 0.55
    picture = np.where(orange[..., None], np.array([238, 98, 22]), np.array([244, 244, 240]))
    return _picture(picture + rng.normal(0, 3, (size, size, 1)))


def plain(colour: tuple[float, float, float], size: int = 8) -> Picture:
    """Return one colour (0 to 1)."""
    return _picture(np.full((size, size, 3), np.array(colour) * 255))


def _patches(rng: np.random.Generator, size: int, cells: int) -> NDArray[np.float64]:
    """Return smooth noise (size, size) of about unit strength with `cells` bumps along a side."""
    coarse = Image.fromarray(rng.normal(0, 1, (cells, cells)).astype(np.float32))
    return np.asarray(coarse.resize((size, size), Image.Resampling.BICUBIC), dtype=np.float64)


def _picture(values: NDArray[np.float64]) -> Picture:
    return np.clip(values, 0, 255).astype(np.uint8)
