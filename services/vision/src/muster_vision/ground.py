"""What the bare ground looks like, and what differs from it.

Ground changes slowly from place to place, so its colour at a cell is the median over the surroundings. A shadow keeps
the ground's chromaticity and only dims it, so it is not taken for a thing.
"""

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from .birdseye import Mask, Window
from .camera import Picture

BLOCK_M: Final = 4.0
NEIGHBOURS: Final = 5
"""The median goes over this many blocks square: things that fill less than half of it do not matter."""
SHADE: Final = (0.42, 1.45)
"""Brightness over that of the ground around, between which only the chromaticity counts."""
SIGMAS: Final = 5.0
LEAST_SIGMA: Final = 0.006

_Floats = npt.NDArray[np.float32]


class Ground:
    """The ground's look over a whole view."""

    def __init__(self, picture: Picture, covered: Mask, cell_m: float) -> None:
        """Learn it from a view (rows, columns, 3) and the cells that cameras cover."""
        colours = _colours(picture)
        self._look = _ground(colours, covered, cell_m)
        step = max(1, round(0.5 / cell_m))
        away = np.abs(colours[::step, ::step, :2] - self._look[::step, ::step, :2])[covered[::step, ::step]]
        # 1.4826 makes a median deviation a standard deviation
        spread = 1.4826 * np.median(away, axis=0) if len(away) else np.zeros(2)
        self._sigma = np.maximum(spread, LEAST_SIGMA).astype(np.float32)

    def things(self, picture: Picture, window: Window) -> Mask:
        """Return which cells of a window of a view (rows, columns, 3) differ from the ground around them."""
        # a rim of two cells, so that smoothing sees the same as in the whole view
        rim = Window(max(0, window.top - 2), max(0, window.left - 2), window.bottom + 2, window.right + 2)
        inner = Window(window.top - rim.top, window.left - rim.left, window.bottom - rim.top, window.right - rim.left)
        colours = _colours(picture[rim.cells])[inner.cells]
        ground = self._look[window.cells]
        away = (colours[..., :2] - ground[..., :2]) / self._sigma
        strange = np.square(away).sum(axis=-1) > SIGMAS**2
        shade = colours[..., 2] / np.maximum(ground[..., 2], 1.0)
        return strange | (shade < SHADE[0]) | (shade > SHADE[1])


def _colours(picture: Picture) -> _Floats:
    """Return (red share, blue share, brightness) of each cell, slightly smoothed."""
    smooth = cv2.GaussianBlur(picture, (0, 0), 0.8).astype(np.float32)
    total = smooth.sum(axis=2) + 12.0
    return np.dstack([smooth[..., 0] / total, smooth[..., 2] / total, total])


def _ground(colours: _Floats, covered: Mask, cell_m: float) -> _Floats:
    """Return the ground's colour at each cell."""
    rows, columns = covered.shape
    block = max(1, round(BLOCK_M / cell_m))
    down, across = -(-rows // block), -(-columns // block)
    sparse = np.where(covered[..., None], colours, np.nan)[:: max(1, block // 13), :: max(1, block // 13)]
    blocks = np.full((down, across, 3), np.nan, np.float32)
    with np.errstate(invalid="ignore"):
        for i, band in enumerate(np.array_split(sparse, down)):
            for j, part in enumerate(np.array_split(band, across, axis=1)):
                known = part[~np.isnan(part[..., 0])]
                if len(known):
                    blocks[i, j] = np.median(known, axis=0)
    half = NEIGHBOURS // 2
    padded = np.pad(blocks, ((half, half), (half, half), (0, 0)), constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(padded, (NEIGHBOURS, NEIGHBOURS), axis=(0, 1))
    flat = around.reshape(down, across, 3, -1)
    known = ~np.isnan(flat).all(axis=-1)
    middle = np.zeros((down, across, 3), np.float32)
    middle[known] = np.nanmedian(flat[known], axis=-1)
    return np.asarray(cv2.resize(middle, (columns, rows), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
