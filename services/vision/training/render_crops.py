"""Cut crops out of rendered scenes exactly as the detector does, with what each shows.

Positives are framed by selective search and by shaken truth; negatives are bare ground, shadows, parts of machines and
pieces of things.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from muster_vision import outline, regions
from muster_vision.birdseye import Grid, Window
from muster_vision.camera import Picture
from muster_vision.detector import SMALLEST_M2, crop, propose
from muster_vision.ground import Ground
from PIL import Image

from .scenes import CLASSES, GROUND, PART, Scene, Truth, scenes

SIDE = 64
LABELS = (*CLASSES, GROUND, PART)
MOST = 16
"""Crops of a label from one scene."""


@dataclass(frozen=True)
class Crops:
    """Pictures (N, 64, 64, 3), labels (N,) as indices of `LABELS`."""

    pictures: npt.NDArray[np.uint8]
    labels: npt.NDArray[np.int64]


def render(first: int, count: int) -> Crops:
    """Return the crops of the scenes with seeds `first` to `first + count - 1`."""
    pictures: list[Picture] = []
    labels: list[int] = []
    for number, scene in enumerate(scenes(first, count)):
        rng = np.random.default_rng([first + number, 5])
        found = [*_proposed(scene), *_shaken(scene, rng), *_anywhere(scene, rng)]
        for region, label in _balanced(found, rng):
            square = Image.fromarray(crop(scene.view.picture, region)).resize((SIDE, SIDE), Image.Resampling.BICUBIC)
            pictures.append(np.asarray(square))
            labels.append(LABELS.index(label))
        if (number + 1) % 25 == 0:
            print(f"{number + 1} of {count} scenes, {len(labels)} crops", flush=True)
    return Crops(np.stack(pictures), np.array(labels))


def _proposed(scene: Scene) -> Iterator[tuple[Window, str]]:
    view = scene.view
    differs = Ground(view.picture, view.covered, view.grid.cell_m).things(view.picture, view.grid.whole) & view.covered
    for window in regions.windows(differs, view.grid, margin_m=1.0):
        labels = outline.segments(view.picture, window, differs[window.cells])
        for region in propose(view, window, differs, labels):
            mask = outline.thing_in(region, window, labels, differs[window.cells])
            if mask.sum() * view.grid.cell_m**2 >= SMALLEST_M2:
                framed = outline.bounds(mask, window)
                label = label_of(framed, scene.truths, view.grid)
                if label is not None:
                    yield framed, label


def _shaken(scene: Scene, rng: np.random.Generator) -> Iterator[tuple[Window, str]]:
    """Yield the truth's own frames, a little off, and places anywhere."""
    grid = scene.view.grid
    for truth in scene.truths:
        west, south, east, north = truth.box
        for _ in range(2):
            size = np.array([east - west, north - south]) * rng.uniform(0.9, 1.25, 2)
            middle = np.array([west + east, south + north]) / 2 + rng.uniform(-0.1, 0.1, 2) * size
            region = _window(grid, *(middle - size / 2), *(middle + size / 2))
            label = label_of(region, scene.truths, grid)
            if label is not None and min(region.size) > 3:
                yield region, label


def _anywhere(scene: Scene, rng: np.random.Generator) -> Iterator[tuple[Window, str]]:
    """Yield bare places, and pieces of things."""
    grid = scene.view.grid
    large = [t for t in scene.truths if not t.machine and t.area_m2 > 3]
    for number in range(60):
        if large and number % 3 == 0:
            west, south, east, north = large[int(rng.integers(len(large)))].box
            x, y = rng.uniform(west, east), rng.uniform(south, north)
            side = rng.uniform(0.25, 0.5) * (east - west)
        else:
            x = rng.uniform(grid.min_x, grid.min_x + grid.columns * grid.cell_m)
            y = rng.uniform(grid.max_y - grid.rows * grid.cell_m, grid.max_y)
            side = rng.uniform(1.0, 6.0)
        region = _window(grid, x - side / 2, y - side / 2, x + side / 2, y + side / 2)
        if min(region.size) > 3 and scene.view.covered[region.cells].all():
            label = label_of(region, scene.truths, grid)
            if label in (GROUND, PART):
                yield region, label


def _balanced(found: Sequence[tuple[Window, str]], rng: np.random.Generator) -> Iterator[tuple[Window, str]]:
    """Yield at most `MOST` of each label, chosen at random."""
    for label in LABELS:
        of_label = [f for f in found if f[1] == label]
        for index in sorted(rng.permutation(len(of_label))[:MOST].tolist()):
            yield of_label[index]


def label_of(region: Window, truths: Sequence[Truth], grid: Grid) -> str | None:
    """Return what a region shows; None if that is open to debate."""
    boxes = [(t, _window(grid, *t.box)) for t in truths]
    area = region.size[0] * region.size[1]
    shared = [(t, w, _shared(region, w)) for t, w in boxes]
    whole = [(regions.overlap(region, w), t, w) for t, w, _ in shared if not t.machine]
    machines = [(regions.overlap(region, w), t, s) for t, w, s in shared if t.machine and s > 0]
    best = max(whole, key=lambda a: a[0], default=None)
    machine = max(machines, key=lambda a: a[0], default=None)
    in_machine = max((s for _, _, s in machines), default=0) / area
    if best is not None and best[0] >= 0.5 and in_machine < 0.5:
        return best[1].label
    if machine is not None and (machine[0] >= 0.4 or in_machine >= 0.7):
        things_inside = max((_shared(region, w) for _, _, w in whole), default=0) / area
        return machine[1].label if things_inside < 0.2 else None
    if sum(s for _, _, s in shared) < 0.04 * area:
        return GROUND
    if any(_shared(region, w) > 0.8 * area and overlap < 0.25 for overlap, _, w in whole) and in_machine == 0:
        return PART
    return None


def _shared(a: Window, b: Window) -> int:
    rows = min(a.bottom, b.bottom) - max(a.top, b.top)
    columns = min(a.right, b.right) - max(a.left, b.left)
    return max(0, rows) * max(0, columns)


def _window(grid: Grid, west: float, south: float, east: float, north: float) -> Window:
    (left, bottom), (right, top) = grid.to_cells(np.array([[west, south], [east, north]]))
    return grid.clip(Window(round(top), round(left), round(bottom) + 1, round(right) + 1))


def main() -> None:
    """Render crops into a file: `python -m training.render_crops FIRST COUNT FILE.npz`."""
    first, count, path = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
    crops = render(first, count)
    np.savez_compressed(path, pictures=crops.pictures, labels=crops.labels)


if __name__ == "__main__":
    main()
