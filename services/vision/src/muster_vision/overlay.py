"""Draws what vision recognised onto the bird's-eye view, for people."""

from collections.abc import Iterable
from typing import Final

import cv2
import numpy as np
from muster_schemas.world import MapObject

from .birdseye import Grid
from .camera import Picture

COLOURS: Final = ((255, 60, 60), (60, 200, 255), (255, 230, 60), (200, 90, 255), (90, 255, 120), (255, 150, 40))


def overlay(picture: Picture, grid: Grid, objects: Iterable[MapObject], zoom: int = 2) -> Picture:
    """Return the view (rows, columns, 3; RGB), `zoom` times as large, with outlines, centres, names and metres."""
    size = (grid.columns * zoom, grid.rows * zoom)
    drawn = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
    classes: dict[str, int] = {}
    for thing in objects:
        colour = COLOURS[classes.setdefault(thing.object_class, len(classes)) % len(COLOURS)]
        points = [(p.x, p.y) for p in (thing.position, *thing.shape)]
        cells = np.round((grid.to_cells(np.array(points, np.float64)) + 0.5) * zoom).astype(np.int32)
        if thing.shape:
            cv2.polylines(drawn, [cells[1:]], isClosed=True, color=colour, thickness=2)
        column, row = (int(c) for c in cells[0])
        cv2.drawMarker(drawn, (column, row), colour, cv2.MARKER_CROSS, 10, 2)
        label = f"{thing.name} ({thing.position.x:.1f}, {thing.position.y:.1f}) {thing.confidence:.2f}"
        # dark behind bright, so that it can be read on any ground
        for ink, shift in (((0, 0, 0), 1), ((255, 255, 255), 0)):
            corner = (column + 6 + shift, row - 8 + shift)
            cv2.putText(drawn, label, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.45, ink, 1, cv2.LINE_AA)
    return drawn
