"""Where to look: what changed since the last look, and selective search for regions that may be things.

Selective search joins the segments of Felzenszwalb and Huttenlocher's graph segmentation by likeness; OpenCV's "fast"
preset tries them in many colour spaces and takes seconds. Here one colour space and two coarsenesses on a reduced view
are enough, since what lies on a site differs from its ground.
"""

import itertools
from collections.abc import Iterable, Sequence
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from .birdseye import Grid, Mask, Window
from .camera import Picture

SEARCH_CELL_M: Final = 0.2
"""Resolution of the search; outlines are found at the grid's own."""
CHANGED_LEVELS: Final = 16
"""A cell has changed if a colour differs by more than this (of 255) after smoothing: more than JPEG noise."""
SMALLEST_CHANGE_M: Final = 0.4
COARSENESSES: Final = (60.0, 200.0)
SIDES_M: Final = (0.6, 9.0)
LONGEST: Final = 3.5
"""Largest ratio of a region's sides."""
ALIKE: Final = 0.8
"""Regions that overlap more than this (intersection over union) count as one."""

_cv2: Final[Any] = cv2  # whose stubs do not know what NumPy's array operations return
_segmentation: Final[Any] = _cv2.ximgproc.segmentation


def changed(before: Picture, now: Picture, cell_m: float) -> Mask:
    """Return which cells differ between two views (rows, columns, 3) by more than noise."""
    blur = (3, 3)
    difference = cv2.absdiff(cv2.blur(before, blur), cv2.blur(now, blur)).max(axis=2)
    mask = (difference > CHANGED_LEVELS).astype(np.uint8)
    side = max(1, round(SMALLEST_CHANGE_M / cell_m) // 2)
    opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((side, side), np.uint8))
    return opened.astype(np.bool_)


def windows(mask: Mask, grid: Grid, margin_m: float = 3.0) -> list[Window]:
    """Return windows, none touching another, that hold all marked cells and a margin around them."""
    if not mask.any():
        return []
    # joining on a coarse copy is as good and far cheaper
    step = max(1, round(1.0 / grid.cell_m))
    rows, columns = (-(-n // step) for n in mask.shape)
    padded = np.zeros((rows * step, columns * step), np.bool_)
    padded[: mask.shape[0], : mask.shape[1]] = mask
    coarse = np.asarray(padded.reshape(rows, step, columns, step).any(axis=(1, 3)), dtype=np.bool_)
    margin = round(margin_m / grid.cell_m)
    found = [
        grid.clip(
            Window(
                y * step - margin,
                x * step - margin,
                (y + h) * step + margin,
                (x + w) * step + margin,
            )
        )
        for x, y, w, h in _pieces(coarse)
    ]
    return _join(found)


def _join(found: list[Window]) -> list[Window]:
    joined = True
    while joined:
        joined = False
        for a, b in itertools.combinations(found, 2):
            if a.touches(b):
                found = [w for w in found if w not in (a, b)] + [a.union(b)]
                joined = True
                break
    return found


def propose(picture: Picture, window: Window, grid: Grid) -> list[Window]:
    """Return the regions of a window that may be things, by selective search; largest first.

    Args:
        picture: the whole view (rows, columns, 3), RGB.
        window: where to search.
        grid: of the view.

    """
    part = picture[window.cells]
    shrink = max(1.0, SEARCH_CELL_M / grid.cell_m)
    size = (round(part.shape[1] / shrink), round(part.shape[0] / shrink))
    if min(size) < 4:
        return []
    small = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(small, cv2.COLOR_RGB2Lab)
    search = _segmentation.createSelectiveSearchSegmentation()
    search.setBaseImage(lab)
    search.addImage(lab)
    for coarseness in COARSENESSES:
        search.addGraphSegmentation(_segmentation.createGraphSegmentation(0.5, coarseness, 10))
    search.addStrategy(
        _segmentation.createSelectiveSearchSegmentationStrategyMultiple(
            _segmentation.createSelectiveSearchSegmentationStrategyColor(),
            _segmentation.createSelectiveSearchSegmentationStrategyFill(),
            _segmentation.createSelectiveSearchSegmentationStrategySize(),
            _segmentation.createSelectiveSearchSegmentationStrategyTexture(),
        )
    )
    boxes: Iterable[Sequence[int]] = search.process()
    found: list[Window] = []
    for x, y, width, height in boxes:
        region = grid.clip(
            Window(
                window.top + int(y * shrink),
                window.left + int(x * shrink),
                window.top + int((y + height) * shrink + 0.999),
                window.left + int((x + width) * shrink + 0.999),
            )
        )
        if _plausible(region, grid) and not _cut_off(region, window, grid):
            found.append(region)
    return distinct(sorted(found, key=lambda r: -r.size[0] * r.size[1]))


def blobs(mask: Mask, window: Window, grid: Grid) -> list[Window]:
    """Return the tight windows of the connected pieces of a mask (of the whole grid) within a window."""
    found = [
        Window(window.top + y, window.left + x, window.top + y + h, window.left + x + w)
        for x, y, w, h in _pieces(mask[window.cells])
    ]
    return [region for region in found if _plausible(region, grid) and not _cut_off(region, window, grid)]


def touched(mask: Mask, by: Mask) -> Mask:
    """Return the connected pieces of a mask that another one touches, whole."""
    labels = labelled(mask)
    hit = np.zeros(int(labels.max()) + 1, np.bool_)
    hit[np.unique(labels[by])] = True
    hit[0] = False
    return hit[labels]


def labelled(mask: Mask) -> npt.NDArray[np.int32]:
    """Return the number of the connected piece of each cell; 0 where the mask is not set."""
    return np.asarray(_cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)[1], dtype=np.int32)


def distinct(regions: Iterable[Window]) -> list[Window]:
    """Return the regions without those that are nearly the same as an earlier one."""
    kept: list[Window] = []
    for region in regions:
        if all(overlap(region, other) < ALIKE for other in kept):
            kept.append(region)
    return kept


def overlap(a: Window, b: Window) -> float:
    """Return intersection over union of two windows."""
    rows = min(a.bottom, b.bottom) - max(a.top, b.top)
    columns = min(a.right, b.right) - max(a.left, b.left)
    if rows <= 0 or columns <= 0:
        return 0.0
    common = rows * columns
    return common / (a.size[0] * a.size[1] + b.size[0] * b.size[1] - common)


def _plausible(region: Window, grid: Grid) -> bool:
    short, long = sorted(n * grid.cell_m for n in region.size)
    return short >= SIDES_M[0] and long <= SIDES_M[1] and long <= LONGEST * short


def _cut_off(region: Window, window: Window, grid: Grid) -> bool:
    """Whether a region ends where the search did, and not where the view does: then it is part of something."""
    return (
        (region.top <= window.top and window.top > 0)
        or (region.left <= window.left and window.left > 0)
        or (region.bottom >= window.bottom and window.bottom < grid.rows)
        or (region.right >= window.right and window.right < grid.columns)
    )


def _pieces(mask: Mask) -> list[tuple[int, int, int, int]]:
    """Return x, y, width and height of each connected piece of a mask."""
    _, _, stats, _ = _cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return [(int(x), int(y), int(w), int(h)) for x, y, w, h, _ in stats[1:]]
