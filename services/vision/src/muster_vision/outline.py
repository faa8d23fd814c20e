"""The shape of a region's thing, and where it touches the ground."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from .birdseye import Grid, Mask, Window
from .camera import Floats, Picture, View
from .regions import labelled

COLOURS: Final = 4
"""Told apart in one window."""
LIGHTNESS: Final = 0.4
"""What a difference in lightness counts, against one in hue: the sides of a thing are lit differently."""
MOSTLY: Final = 0.6
CORNERS: Final = 48
"""At most this many in an outline."""

_cv2: Final[Any] = cv2  # whose stubs do not know what NumPy's array operations return


@dataclass(frozen=True)
class Shape:
    """A region's thing on the grid. Metres."""

    window: Window
    mask: Mask
    """Of the window's size."""
    centre: Floats
    """(2,), the middle of its area as it is seen."""
    outline: Floats
    """(N, 2), counter-clockwise or clockwise."""
    length_m: float
    width_m: float
    area_m2: float


def segments(picture: Picture, window: Window, differs: Mask) -> npt.NDArray[np.int32]:
    """Return the label of each cell of a window: cells of like colour that hang together share one; ground has 0.

    Colours are found by k-means over the cells that differ from the ground. (Graph segmentation, which the search
    uses, lets a heap run into the puddle that it lies in: their edge is no sharper than the water's own patches.)
    """
    chosen = np.argwhere(differs)
    labels = np.zeros(differs.shape, np.int32)
    if len(chosen) < COLOURS:
        labels[differs] = 1
        return labels
    lab = np.asarray(_cv2.cvtColor(_cv2.medianBlur(picture[window.cells].copy(), 3), cv2.COLOR_RGB2Lab), np.float32)
    points = lab[differs] * np.array([LIGHTNESS, 1.0, 1.0], np.float32)
    _cv2.setRNGSeed(1)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 12, 0.5)
    _, colours, _ = _cv2.kmeans(points, COLOURS, None, stop, 1, cv2.KMEANS_PP_CENTERS)
    clusters = np.zeros(differs.shape, np.uint8)
    clusters[differs] = colours.ravel() + 1
    clusters = np.where(differs, _cv2.medianBlur(clusters, 5), 0)
    for colour in range(1, COLOURS + 1):
        pieces = labelled(clusters == colour)
        labels = np.where(pieces > 0, pieces + labels.max(), labels)
    # cells that the smoothing took away from every colour
    labels[differs & (labels == 0)] = labels.max() + 1
    return labels.astype(np.int32)


def framed(labels: npt.NDArray[np.int32], window: Window, differs: Mask, least: int) -> list[Window]:
    """Return the windows of segments that have at least `least` cells which differ from the ground."""
    sizes = np.bincount(labels[differs], minlength=int(labels.max()) + 1)
    return [bounds(labels == number, window) for number in np.flatnonzero(sizes >= least).tolist()]


def thing_in(region: Window, window: Window, labels: npt.NDArray[np.int32], differs: Mask) -> Mask:
    """Return the cells (of the window) of the thing that a region frames.

    They are those that differ from the ground and belong to segments that lie mostly in the region; of several pieces
    the largest counts.

    Args:
        region: within the window.
        window: what `labels` and `differs` are of.
        labels: from `segments`.
        differs: cells that differ from the ground.

    """
    inside = np.zeros(labels.shape, np.bool_)
    inside[within(region, window)] = True
    count = int(labels.max()) + 1
    everywhere = np.bincount(labels[differs], minlength=count)
    held = np.bincount(labels[differs & inside], minlength=count)
    chosen = held >= np.maximum(MOSTLY * everywhere, 1)
    return largest_piece(chosen[labels] & differs)


def within(region: Window, window: Window) -> tuple[slice, slice]:
    """Return the index of a region, or the part of it that lies in a window, in an array of the window."""
    return (
        slice(max(0, region.top - window.top), max(0, region.bottom - window.top)),
        slice(max(0, region.left - window.left), max(0, region.right - window.left)),
    )


def largest_piece(mask: Mask) -> Mask:
    """Return the largest connected piece, its gaps of a cell closed and its holes filled."""
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    whole = np.zeros_like(closed)
    if contours:
        cv2.drawContours(whole, [max(contours, key=cv2.contourArea)], -1, 1, thickness=cv2.FILLED)
    return whole.astype(np.bool_)


def piece_with(mask: Mask, core: Mask) -> Mask:
    """Return the connected piece of a mask that shares most with another mask of the same window, holes filled."""
    labels = labelled(mask)
    shared = np.bincount(labels[core & mask], minlength=1)
    if not shared.any():
        return np.zeros_like(mask)
    return largest_piece(labels == int(shared.argmax()))


def common(a: Shape, b: Shape) -> float:
    """Return the share of the smaller of two shapes that lies in the other."""
    top, left = max(a.window.top, b.window.top), max(a.window.left, b.window.left)
    bottom, right = min(a.window.bottom, b.window.bottom), min(a.window.right, b.window.right)
    if top >= bottom or left >= right:
        return 0.0
    of_a = a.mask[top - a.window.top : bottom - a.window.top, left - a.window.left : right - a.window.left]
    of_b = b.mask[top - b.window.top : bottom - b.window.top, left - b.window.left : right - b.window.left]
    return float((of_a & of_b).sum() / max(1, min(a.mask.sum(), b.mask.sum())))


def alike(a: Shape, b: Shape) -> bool:
    """Whether two shapes are nearly the same."""
    return common(a, b) > 0.9 and 0.85 < a.area_m2 / b.area_m2 < 1.18


def shape(mask: Mask, window: Window, grid: Grid) -> Shape | None:
    """Return the shape of a mask of a window; None if it is empty."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    if not contours:
        return None
    contour = max(contours, key=cv2.contourArea)
    tolerance = 0.5
    corners = cv2.approxPolyDP(contour, tolerance, closed=True)
    while len(corners) > CORNERS:
        tolerance *= 1.5
        corners = cv2.approxPolyDP(contour, tolerance, closed=True)
    offset = np.array([window.left, window.top], np.float64)
    rows, columns = np.nonzero(mask)
    middle = np.array([[columns.mean(), rows.mean()]]) + offset
    _, sides, _ = cv2.minAreaRect(contour)
    # contours run through the middles of the outermost cells, so half a cell is missing on each side
    long, short = sorted(((s + 1) * grid.cell_m for s in sides), reverse=True)
    return Shape(
        window=window,
        mask=mask,
        centre=grid.to_ground(middle)[0],
        outline=grid.to_ground(corners.reshape(-1, 2).astype(np.float64) + offset),
        length_m=float(long),
        width_m=float(short),
        area_m2=float(len(rows) * grid.cell_m**2),
    )


def bounds(mask: Mask, window: Window) -> Window:
    """Return the tight window around a mask of a window; empty if the mask is."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return Window(window.top, window.left, window.top, window.left)
    return Window(
        window.top + int(rows[0]),
        window.left + int(columns[0]),
        window.top + int(rows[-1]) + 1,
        window.left + int(columns[-1]) + 1,
    )


def middle_height(centres: Sequence[Floats], views: Sequence[View]) -> float | None:
    """Return how high above the ground the middle of a thing is, from where several cameras see it on the ground.

    The middle at height z appears z tan(angle) farther from each camera's foot, so the views' disagreement tells z.

    Args:
        centres: (2,) each, the middle of its area as each camera lays it out.
        views: of the same cameras.

    Returns:
        Metres, at least 0; None if the views are too alike to tell.

    """
    shifts = np.array([np.multiply(*view.sight(c)) for c, view in zip(centres, views, strict=True)])
    spread = shifts - shifts.mean(axis=0)
    offsets = np.array(centres) - np.mean(centres, axis=0)
    baseline = float((spread**2).sum())
    if baseline < 0.05:
        return None
    return max(0.0, float((spread * offsets).sum()) / baseline)


def foot(centre: Floats, view: View, height_m: float) -> Floats:
    """Return the ground point (2,) below a thing's middle that is seen at `centre` and is `height_m` high."""
    away, tangent = view.sight(centre)
    return centre - away * tangent * height_m
