"""The bird's-eye view: frames laid onto a fixed metric grid of the site by homography, several cameras in one mosaic.

Rows run from north to south, columns from west to east. Everything flat on the ground is where it belongs; what
stands up leans away from the camera that shows it (`camera.View.sight`).
"""

import zlib
from dataclasses import dataclass, field
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt
from muster_schemas.site import Bounds
from muster_schemas.world import CameraFrame

from .camera import Floats, FrameError, Picture, View, decode

MAX_CELLS = 4_000_000
SHARPNESS = 200.0
"""How much the steeper of two views wins: at 200 seams are about a metre wide, so leaning tops hardly ghost."""
STEEPEST_TANGENT = 3.0
"""Ground seen flatter than this (72 degrees off the vertical) is not used."""
STALE_S = 10.0
"""A camera this much older than the newest gives way wherever another one sees the ground."""

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Window:
    """A rectangle of cells: rows top..bottom and columns left..right, ends excluded."""

    top: int
    left: int
    bottom: int
    right: int

    @property
    def cells(self) -> tuple[slice, slice]:
        """The index that cuts it out of a grid-sized array."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.bottom - self.top, self.right - self.left

    def union(self, other: Self) -> "Window":
        """Return the smallest window that holds both."""
        return Window(
            min(self.top, other.top),
            min(self.left, other.left),
            max(self.bottom, other.bottom),
            max(self.right, other.right),
        )

    def touches(self, other: Self) -> bool:
        """Whether both share a cell."""
        return (
            self.top < other.bottom and other.top < self.bottom and self.left < other.right and other.left < self.right
        )


@dataclass(frozen=True)
class Grid:
    """Square cells over a site's bounds."""

    min_x: float
    max_y: float
    cell_m: float
    rows: int
    columns: int

    @classmethod
    def over(cls, bounds: Bounds, cell_m: float = 0.1) -> Self:
        """Return the grid of a site; cells grow beyond `cell_m` where there would be more than `MAX_CELLS`."""
        width, height = bounds.max_x - bounds.min_x, bounds.max_y - bounds.min_y
        cell_m = max(cell_m, (width * height / MAX_CELLS) ** 0.5)
        return cls(
            min_x=bounds.min_x,
            max_y=bounds.max_y,
            cell_m=cell_m,
            rows=max(1, round(height / cell_m)),
            columns=max(1, round(width / cell_m)),
        )

    @property
    def whole(self) -> Window:
        """The window of all cells."""
        return Window(0, 0, self.rows, self.columns)

    def to_ground(self, cells: Floats) -> Floats:
        """Return ground points (N, 2) of (column, row) pairs (N, 2); whole numbers are the middles of cells."""
        return np.column_stack(
            [
                self.min_x + (cells[:, 0] + 0.5) * self.cell_m,
                self.max_y - (cells[:, 1] + 0.5) * self.cell_m,
            ]
        )

    def to_cells(self, ground: Floats) -> Floats:
        """Return (column, row) pairs (N, 2) of ground points (N, 2); the inverse of `to_ground`."""
        return np.column_stack(
            [(ground[:, 0] - self.min_x) / self.cell_m - 0.5, (self.max_y - ground[:, 1]) / self.cell_m - 0.5]
        )

    def around(self, ground: Floats, margin_m: float) -> Window:
        """Return the window that holds ground points (N, 2) and a margin, cut off at the grid's edge."""
        cells = self.to_cells(ground)
        margin = margin_m / self.cell_m
        left, top = np.floor(cells.min(axis=0) - margin)
        right, bottom = np.ceil(cells.max(axis=0) + margin) + 1
        return self.clip(Window(int(top), int(left), int(bottom), int(right)))

    def clip(self, window: Window) -> Window:
        """Return the part of a window that lies on the grid (possibly empty)."""
        top, left = max(0, min(window.top, self.rows)), max(0, min(window.left, self.columns))
        return Window(top, left, max(top, min(window.bottom, self.rows)), max(left, min(window.right, self.columns)))

    def paint(self, polygon: Floats) -> Mask:
        """Return the mask (rows, columns) of the cells inside a ground polygon (N, 2)."""
        mask = np.zeros((self.rows, self.columns), np.uint8)
        cv2.fillPoly(mask, [np.round(self.to_cells(polygon)).astype(np.int32)], 1)
        return mask.astype(np.bool_)

    @property
    def matrix(self) -> Floats:
        """The affine map (3 x 3) from (column, row, 1) to ground (x, y, 1)."""
        half = 0.5 * self.cell_m
        return np.array(
            [[self.cell_m, 0.0, self.min_x + half], [0.0, -self.cell_m, self.max_y - half], [0.0, 0.0, 1.0]],
            dtype=np.float64,
        )


def lay_out(picture: Picture, view: View, grid: Grid) -> tuple[Picture, Mask]:
    """Return a picture laid onto the grid (rows, columns, 3), and which cells it covers."""
    # A picture finer than the grid is averaged first; sampling it as it is would pick single pixels.
    cell_in_px = grid.cell_m * min(view.matrix[0, 0], view.matrix[1, 1]) / view.centre[2]
    shrink = max(1, int(cell_in_px))
    if shrink > 1:
        rows, columns = picture.shape[0] // shrink, picture.shape[1] // shrink
        picture = np.asarray(
            cv2.resize(picture[: rows * shrink, : columns * shrink], (columns, rows), interpolation=cv2.INTER_AREA),
            dtype=np.uint8,
        )
    # the middle of the first averaged pixel is the middle of the `shrink` pixels that it averages
    half = 0.5 * (1 / shrink - 1)
    averaged = np.array([[1 / shrink, 0, half], [0, 1 / shrink, half], [0, 0, 1]])
    to_picture = averaged @ view.ground_to_image @ grid.matrix
    laid = cv2.warpPerspective(
        picture, to_picture, (grid.columns, grid.rows), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    columns, rows = np.meshgrid(np.arange(grid.columns, dtype=np.float32), np.arange(grid.rows, dtype=np.float32))
    u, v, depth = (m[0] * columns + m[1] * rows + m[2] for m in to_picture.astype(np.float32))
    height, width = picture.shape[:2]
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = (depth > 0) & (u >= 0) & (v >= 0) & (u <= (width - 1) * depth) & (v <= (height - 1) * depth)
    return np.asarray(laid, dtype=np.uint8), np.asarray(inside, dtype=np.bool_)


@dataclass
class Layer:
    """One camera's part of the mosaic."""

    view: View
    picture: Picture
    preference: npt.NDArray[np.float32]
    """Log of the weight in each cell; -inf where the camera does not see it."""
    share: npt.NDArray[np.float32]
    """Its weight after all cameras' weights were made to add up to one."""
    taken_at: float
    digest: int
    extent: Window


@dataclass
class BirdsEye:
    """The mosaic of all cameras."""

    grid: Grid
    layers: dict[str, Layer] = field(default_factory=dict[str, Layer])

    def __post_init__(self) -> None:
        self.picture: Picture = np.zeros((self.grid.rows, self.grid.columns, 3), np.uint8)
        self.covered: Mask = np.zeros((self.grid.rows, self.grid.columns), np.bool_)
        self._stale: frozenset[str] = frozenset()

    def add(self, frame: CameraFrame, jpeg: bytes) -> bool:
        """Lay a frame into the mosaic and return whether it changed anything.

        Raises:
            FrameError: the frame is malformed, or shows no ground within the bounds. Nothing has changed then.

        """
        digest = zlib.crc32(jpeg)
        view = View.of_frame(frame)
        old = self.layers.get(frame.camera_id)
        if old is not None and old.view.same_as(view):
            if old.digest == digest:
                old.taken_at = frame.taken_at
                return False
            picture, inside = self._lay_out(frame, jpeg, view)
            changed = _extent(np.any(picture != old.picture, axis=2) & inside)
            old.picture, old.taken_at, old.digest = picture, frame.taken_at, digest
            self._compose(changed)
            return changed.size[0] > 0
        picture, inside = self._lay_out(frame, jpeg, view)
        preference = np.where(inside, self._preference(view), -np.inf).astype(np.float32)
        layer = Layer(view, picture, preference, np.zeros_like(preference), frame.taken_at, digest, _extent(inside))
        self.layers[frame.camera_id] = layer
        self._share_out()
        self._compose(layer.extent if old is None else layer.extent.union(old.extent))
        return True

    def yield_stale(self) -> bool:
        """Let cameras that fell silent give way to others that see the same ground; return whether that changed any."""
        if self._find_stale() == self._stale:
            return False
        self._share_out()
        self._compose(self.grid.whole)
        return True

    def ages(self, now: float) -> npt.NDArray[np.float32]:
        """Return the age in seconds of each cell (rows, columns); infinite where no camera looks."""
        age = np.full((self.grid.rows, self.grid.columns), np.inf, np.float32)
        best = np.zeros_like(age)
        for layer in self.layers.values():
            wins = layer.share > best
            best[wins] = layer.share[wins]
            age[wins] = now - layer.taken_at
        return age

    def layers_seeing(self, window: Window) -> list[Layer]:
        """Return the layers that see all of a window."""
        return [
            a for a in self.layers.values() if np.isfinite(a.preference[window.cells]).all() and min(window.size) > 0
        ]

    def _lay_out(self, frame: CameraFrame, jpeg: bytes, view: View) -> tuple[Picture, Mask]:
        picture, inside = lay_out(decode(frame, jpeg), view, self.grid)
        if not inside.any():
            raise FrameError("the camera sees no ground within the site's bounds")
        return picture, inside

    def _preference(self, view: View) -> npt.NDArray[np.float32]:
        x = self.grid.min_x + (np.arange(self.grid.columns, dtype=np.float32) + 0.5) * self.grid.cell_m
        y = self.grid.max_y - (np.arange(self.grid.rows, dtype=np.float32) + 0.5) * self.grid.cell_m
        squared = ((x - view.centre[0]) ** 2)[None, :] + ((y - view.centre[1]) ** 2)[:, None]
        tangent_squared = squared / np.float32(view.centre[2] ** 2)
        # log of cos^SHARPNESS: the flatter the sight, the less it counts; a higher camera counts as coarser
        preference = -0.5 * SHARPNESS * np.log1p(tangent_squared) - 0.1 * np.log(np.float32(view.centre[2]))
        return np.where(tangent_squared <= STEEPEST_TANGENT**2, preference, -np.inf).astype(np.float32)

    def _find_stale(self) -> frozenset[str]:
        newest = max((layer.taken_at for layer in self.layers.values()), default=0.0)
        return frozenset(name for name, layer in self.layers.items() if newest - layer.taken_at > STALE_S)

    def _share_out(self) -> None:
        self._stale = self._find_stale()
        preferences = {
            name: layer.preference - np.float32(1e6 if name in self._stale else 0.0)
            for name, layer in self.layers.items()
        }
        top = np.maximum.reduce(list(preferences.values()))
        self.covered = np.isfinite(top)
        base = np.where(self.covered, top, 0.0)
        weights = {name: np.exp(np.maximum(p - base, -80.0)) * np.isfinite(p) for name, p in preferences.items()}
        total = np.maximum(np.add.reduce(list(weights.values())), 1e-30)
        for name, layer in self.layers.items():
            share = (weights[name] / total).astype(np.float32)
            # below a hundredth a camera would add nothing to see
            layer.share = np.where(share < 0.01, np.float32(0), share).astype(np.float32)

    def _compose(self, window: Window) -> None:
        if min(window.size) <= 0:
            return
        mixed = np.zeros((*window.size, 3), np.float32)
        total = np.zeros(window.size, np.float32)
        for layer in self.layers.values():
            share = layer.share[window.cells]
            if share.any():
                mixed += layer.picture[window.cells] * share[..., None]
                total += share
        self.picture[window.cells] = (mixed / np.maximum(total, 1e-6)[..., None] + 0.5).astype(np.uint8)


def _extent(mask: Mask) -> Window:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return Window(0, 0, 0, 0)
    return Window(int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1)
