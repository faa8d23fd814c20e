"""From the bird's-eye view to sightings: only what changed is searched, named and measured again."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from . import outline, regions
from .birdseye import BirdsEye, Layer, Mask, Window
from .camera import Floats, Picture
from .clip_model import ClipModel
from .ground import Ground
from .outline import Shape
from .robots import Shadows
from .tracker import Place, Sighting, Track
from .vocabulary import Vocabulary

THRESHOLD: Final = 0.6
"""Least probability of a class, after the softmax over all classes and backgrounds."""
MARGIN: Final = 0.15
"""Of a crop's longer side, left around a region so that the model sees where it ends."""
SMALLEST_M2: Final = 0.5
SMALLEST_LOOSE_M2: Final = 1.2
"""Heaps smaller than this (0.2 m3 of soil) are spills, and no objects."""
FILLED: Final = 0.2
"""Least share of a region that differs from the ground."""
MOST_REGIONS: Final = 120
GROUND_AGE_LOOKS: Final = 20
HEIGHTS: Final = 20
"""Measured heights kept of each class; their median serves where only one camera sees a thing."""
SQUAT: Final = 0.25
"""Height of a thing's middle over its width, as long as nothing of its class was measured by two cameras."""
RIMS_M: Final = (0.3, 1.5)
"""Around a thing, least and best: the room in which one camera's picture of it is looked for."""
BARE: Final = 0.12
"""A place of which less than this differs from the ground is bare ..."""
IN_THE_WAY: Final = 0.25
"""... unless more than this of it may be hidden by a robot."""


@dataclass(frozen=True)
class Found:
    """A region that got a class."""

    object_class: str
    probability: float
    shape: Shape


class Detector:
    """Keeps what was recognised, and searches again where the view has changed."""

    def __init__(self, model: ClipModel, *, flat: Sequence[str] = (), loose: Sequence[str] = ()) -> None:
        """Take the model, and which classes lie flat (no sides to see) and which are loose material (heaps)."""
        self._model = model
        self._flat = frozenset(flat)
        self._loose = frozenset(loose)
        self._explained: Picture | None = None
        self._known: Mask | None = None
        self._pending: Mask | None = None
        """Cells that differ from the ground and were behind a robot when they were searched last."""
        self._differs: Mask | None = None
        self._ground: Ground | None = None
        self._ground_looks = 0
        self._words: tuple[str, ...] = ()
        self._found: list[tuple[Found, Sighting]] = []
        self._heights: dict[str, list[float]] = {}

    def look(self, view: BirdsEye, vocabulary: Vocabulary, shadows: Shadows, *, changed: bool = True) -> list[Sighting]:
        """Return everything that is recognised at present, machines left out.

        Args:
            view: the mosaic as it now is.
            vocabulary: what to look for; a changed one makes everything be looked at again.
            shadows: where robots may hide things.
            changed: the view or the robots changed since the last look; if not, nothing is compared or searched.

        """
        if changed or self._words != vocabulary.names:
            todo = self._changed(view, vocabulary)
            if self._pending is not None:
                todo |= self._pending & ~shadows.mask
            if todo.any():
                self._search(view, vocabulary, shadows, todo)
            # nothing was over it in its picture either, or that picture would have changed since
            self._found = [
                (f, s if s.whole or shadows.may_cover(f.shape) else replace(s, whole=True)) for f, s in self._found
            ]
        return [self._now(view, found, sighting) for found, sighting in self._found if self._in_map(found, vocabulary)]

    def judge(self, view: BirdsEye, shadows: Shadows, track: Track) -> Place:
        """Say what is seen at the place of an object that was not recognised."""
        if self._differs is None:
            return Place.HIDDEN
        place = view.grid.paint(np.array(track.last.outline))
        area = int(place.sum())
        if area == 0 or not view.covered[place].all() or (shadows.mask & place).sum() > IN_THE_WAY * area:
            return Place.HIDDEN
        return Place.BARE if (self._differs & place).sum() < BARE * area else Place.UNCLEAR

    def _changed(self, view: BirdsEye, vocabulary: Vocabulary) -> Mask:
        if self._explained is None or self._known is None or self._words != vocabulary.names:
            self._words = vocabulary.names
            self._explained, self._known = view.picture.copy(), view.covered.copy()
            self._differs = np.zeros_like(view.covered)
            self._found = []
            self._ground = self._pending = None
            return view.covered.copy()
        todo = regions.changed(self._explained, view.picture, view.grid.cell_m) & view.covered
        return todo | (view.covered & ~self._known)

    def _search(self, view: BirdsEye, vocabulary: Vocabulary, shadows: Shadows, todo: Mask) -> None:
        assert self._explained is not None and self._differs is not None  # noqa: S101, PT018  (set by _changed)
        self._ground_looks += 1
        if self._ground is None or self._ground_looks >= GROUND_AGE_LOOKS or todo.sum() > 0.2 * todo.size:
            self._ground, self._ground_looks = Ground(view.picture, view.covered, view.grid.cell_m), 0
        for window in regions.windows(todo, view.grid, margin_m=1.0):
            seen = self._ground.things(view.picture, window) & view.covered[window.cells]
            self._differs[window.cells] = seen
            self._explained[window.cells] = view.picture[window.cells]
        self._known = view.covered.copy()
        self._pending = self._differs & shadows.mask
        blobs = self._differs & ~shadows.mask
        touched = regions.touched(blobs, todo)
        places = regions.windows(touched, view.grid, margin_m=1.0)
        again = [f for f in self._found if self._is_stale(f[0], todo, places)]
        self._found = [f for f in self._found if f not in again]
        named = self._name(view, vocabulary, places, blobs)
        # what several cameras see comes first, since it tells how high the others of its class are
        named.sort(key=lambda f: -len(_seeing(view, f.shape, RIMS_M[0])))
        self._found += [(f, self._measure(view, f, shadows)) for f in named]

    def _is_stale(self, found: Found, todo: Mask, places: Sequence[Window]) -> bool:
        window = found.shape.window
        return bool((todo[window.cells] & found.shape.mask).any()) or any(window.touches(p) for p in places)

    def _name(self, view: BirdsEye, vocabulary: Vocabulary, places: Sequence[Window], blobs: Mask) -> list[Found]:
        """Return what is in the windows: regions proposed, named, framed tightly, named again, and thinned out."""
        framed: list[Shape] = []
        for window in places:
            differs = blobs[window.cells]
            labels = outline.segments(view.picture, window, differs)
            proposed = propose(view, window, blobs, labels)
            masks = (outline.thing_in(region, window, labels, differs) for region in proposed)
            shapes = (outline.shape(mask, window, view.grid) for mask in masks)
            framed += _distinct(s for s in shapes if s is not None and s.area_m2 >= SMALLEST_M2)
        crops = [crop(view.picture, outline.bounds(s.mask, s.window)) for s in framed]
        scores = self._model.scores(crops, vocabulary.prompts)[:, : len(vocabulary.names)]
        named: list[Found] = []
        for shape, row in zip(framed, scores, strict=True):
            best = int(row.argmax())
            name = vocabulary.names[best]
            small = name in self._loose and shape.area_m2 < SMALLEST_LOOSE_M2
            if row[best] >= THRESHOLD and not small:
                named.append(Found(name, float(row[best]), shape))
        return self._thin_out(named)

    def _thin_out(self, named: Sequence[Found]) -> list[Found]:
        """Non-maximum suppression by shape; what lies on something flat (a heap in a puddle) stays."""
        kept: list[Found] = []
        for found in sorted(named, key=lambda f: -_rank(f)):
            rivals = [k for k in kept if outline.common(k.shape, found.shape) > 0.5]
            if any(not self._lies_on(found, k) and not self._lies_on(k, found) for k in rivals):
                continue
            kept.append(found)
        return kept

    def _lies_on(self, upper: Found, lower: Found) -> bool:
        return (
            lower.object_class in self._flat
            and upper.object_class not in self._flat
            and upper.shape.area_m2 < 0.8 * lower.shape.area_m2
        )

    def _in_map(self, found: Found, vocabulary: Vocabulary) -> bool:
        return found.object_class not in vocabulary.machines

    def _measure(self, view: BirdsEye, found: Found, shadows: Shadows) -> Sighting:
        shape = found.shape
        taken_at = _taken_at(view, shape)
        position = shape.centre
        if found.object_class not in self._flat | self._loose:
            position = self._ground_contact(view, found)
        points = shape.outline + (position - shape.centre)
        return Sighting(
            object_class=found.object_class,
            position=(float(position[0]), float(position[1])),
            outline=tuple((float(x), float(y)) for x, y in points),
            length_m=shape.length_m,
            width_m=shape.width_m,
            area_m2=shape.area_m2,
            confidence=found.probability,
            measured_at=taken_at,
            seen_at=taken_at,
            whole=not shadows.may_cover(shape),
        )

    def _ground_contact(self, view: BirdsEye, found: Found) -> Floats:
        """Return where a thing that stands up touches the ground, from all cameras that see it whole."""
        shape = found.shape
        # another camera shows its top elsewhere than the mosaic does; near the edge of a picture a narrow look must do
        windows = {id(layer): (layer, _near(view, shape, rim)) for rim in RIMS_M for layer in _seeing(view, shape, rim)}
        seen: list[tuple[Layer, Shape]] = []
        for layer, window in windows.values():
            piece = self._in_layer(view, layer, shape, window)
            if piece is not None:
                seen.append((layer, piece))
        if not seen:
            # cut in two by a seam: the mosaic shows it as the camera does that sees its middle from most directly above
            seen = [(_above(view, shape), shape)]
        centres, views = [s.centre for _, s in seen], [layer.view for layer, _ in seen]
        heights = self._heights.setdefault(found.object_class, [])
        height = outline.middle_height(centres, views) if len(seen) > 1 else None
        if height is not None:
            heights[:] = [*heights, height][-HEIGHTS:]
        elif heights:
            height = float(np.median(heights))
        else:
            height = SQUAT * shape.width_m
        feet = [outline.foot(c, v, height) for c, v in zip(centres, views, strict=True)]
        # the steeper a camera looks, the less the height matters
        weights = [1.0 / (0.1 + v.sight(c)[1]) for c, v in zip(centres, views, strict=True)]
        return np.average(feet, axis=0, weights=weights)

    def _in_layer(self, view: BirdsEye, layer: Layer, shape: Shape, window: Window) -> Shape | None:
        """Return the thing as one camera shows it."""
        assert self._ground is not None  # noqa: S101  (whoever measures has searched)
        core = np.zeros(window.size, np.bool_)
        core[outline.within(outline.bounds(shape.mask, shape.window), window)] = True
        differs = self._ground.things(layer.picture, window)
        piece = outline.shape(outline.piece_with(differs, core), window, view.grid)
        # much more or less than in the mosaic: something else is in the picture
        return piece if piece is not None and 0.5 < piece.area_m2 / shape.area_m2 < 1.6 else None

    def _now(self, view: BirdsEye, found: Found, sighting: Sighting) -> Sighting:
        return replace(sighting, seen_at=_taken_at(view, found.shape))


def _above(view: BirdsEye, shape: Shape) -> Layer:
    """Return the camera that the mosaic shows a shape's middle from."""
    column, row = view.grid.to_cells(shape.centre[None, :])[0]
    y, x = min(max(0, round(row)), view.grid.rows - 1), min(max(0, round(column)), view.grid.columns - 1)
    return max(view.layers.values(), key=lambda layer: (float(layer.share[y, x]), float(layer.preference[y, x])))


def _taken_at(view: BirdsEye, shape: Shape) -> float:
    return _above(view, shape).taken_at


def _seeing(view: BirdsEye, shape: Shape, rim_m: float) -> list[Layer]:
    return view.layers_seeing(_near(view, shape, rim_m))


def _near(view: BirdsEye, shape: Shape, rim_m: float) -> Window:
    """Return the window of a shape and a rim around it."""
    tight, rim = outline.bounds(shape.mask, shape.window), round(rim_m / view.grid.cell_m)
    return view.grid.clip(Window(tight.top - rim, tight.left - rim, tight.bottom + rim, tight.right + rim))


def propose(view: BirdsEye, window: Window, differs: Mask, labels: npt.NDArray[np.int32]) -> list[Window]:
    """Return regions of a window to name: those of selective search, all blobs that differ from the ground, segments.

    Args:
        view: the mosaic.
        window: where to search.
        differs: cells of the whole grid that differ from the ground.
        labels: the window's `outline.segments`.

    """
    least = round(SMALLEST_M2 / view.grid.cell_m**2)
    found = regions.propose(view.picture, window, view.grid)
    found += regions.blobs(differs, window, view.grid)
    found += outline.framed(labels, window, differs[window.cells], least)
    filled = [r for r in found if differs[r.cells].mean() >= FILLED]
    return regions.distinct(filled)[:MOST_REGIONS]


def crop(picture: Picture, region: Window) -> Picture:
    """Return the square around a region with a margin, the edge of the view repeated where it ends."""
    rows, columns = region.size
    half = math.ceil(max(rows, columns) * (0.5 + MARGIN))
    y, x = (region.top + region.bottom) // 2, (region.left + region.right) // 2
    ys = np.clip(np.arange(y - half, y + half), 0, picture.shape[0] - 1)
    xs = np.clip(np.arange(x - half, x + half), 0, picture.shape[1] - 1)
    return picture[np.ix_(ys, xs)]


def _distinct(shapes: Iterable[Shape]) -> list[Shape]:
    kept: list[Shape] = []
    for shape in shapes:
        if not any(outline.alike(shape, other) for other in kept):
            kept.append(shape)
    return kept


def _rank(found: Found) -> float:
    """Sure before unsure; of those about as sure, the one that frames the whole thing before a part of it."""
    return round(found.probability, 1) + 0.05 * math.log(1 + found.shape.area_m2)
