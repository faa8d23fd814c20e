"""The mosaic on the metric grid."""

from collections.abc import Callable

import numpy as np
import pytest
from muster_schemas.site import Bounds
from muster_schemas.world import CameraFrame
from muster_vision.birdseye import BirdsEye, Grid, Window
from muster_vision.camera import FrameError, Picture, View

MakeFrame = Callable[..., CameraFrame]
JpegOf = Callable[[Picture], bytes]
OneColour = Callable[..., bytes]


def test_cells_and_metres_are_each_others_inverse(grid: Grid) -> None:
    """The first cell's middle lies half a cell inside the north-west corner."""
    assert grid.to_ground(np.array([[0.0, 0.0]])) == pytest.approx(np.array([[-9.95, 4.95]]))
    points = np.array([[1.23, -4.5], [-9.0, 2.0]])
    assert grid.to_ground(grid.to_cells(points)) == pytest.approx(points)


def test_a_large_site_gets_larger_cells() -> None:
    """A square kilometre at 0.1 m would be a hundred million cells."""
    grid = Grid.over(Bounds(min_x=0, min_y=0, max_x=1000, max_y=1000))
    assert grid.cell_m == pytest.approx(0.5)
    assert (grid.rows, grid.columns) == (2000, 2000)


@pytest.mark.parametrize("side", [200, 800])
def test_what_lies_on_the_ground_appears_at_its_metres(
    grid: Grid, make_frame: MakeFrame, jpeg_of: JpegOf, side: int
) -> None:
    """To a fifth of a cell, for pictures coarser and finer than the grid."""
    frame = make_frame(2.0, 1.0, 10.0, side=side)
    view = View.of_frame(frame)
    rows, columns = np.indices((side, side))
    ground = view.ground(np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64))
    spot = np.hypot(*(ground - [3.3, -0.7]).T).reshape(side, side) < 0.8
    picture = np.where(spot[..., None], 250, 20).astype(np.uint8).repeat(1, axis=2)
    birdseye = BirdsEye(grid)
    birdseye.add(frame, jpeg_of(np.ascontiguousarray(np.broadcast_to(picture, (side, side, 3)))))
    found = np.argwhere(birdseye.picture[..., 0] > 128)[:, ::-1].astype(np.float64)
    assert grid.to_ground(found).mean(axis=0) == pytest.approx([3.3, -0.7], abs=0.02)
    assert len(found) * grid.cell_m**2 == pytest.approx(np.pi * 0.8**2, rel=0.05)


def test_each_camera_shows_the_ground_that_it_sees_from_most_directly_above(
    grid: Grid, make_frame: MakeFrame, one_colour: OneColour
) -> None:
    """Two cameras that overlap: each one's colour on its own side, a mixture in between."""
    birdseye = BirdsEye(grid)
    birdseye.add(make_frame(-3.0, 0.0, camera_id="west"), one_colour((200, 0, 0)))
    birdseye.add(make_frame(3.0, 0.0, camera_id="east"), one_colour((0, 0, 200)))
    columns = [round(c) for c in grid.to_cells(np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]]))[:, 0]]
    west, seam, east = birdseye.picture[grid.rows // 2, columns].astype(int)
    assert west[0] > 195
    assert west[2] < 5
    assert east[2] > 195
    assert 60 < seam[0] < 140
    assert 60 < seam[2] < 140


def test_ground_that_no_camera_sees_is_not_covered(grid: Grid, make_frame: MakeFrame, one_colour: OneColour) -> None:
    """And has no age."""
    birdseye = BirdsEye(grid)
    birdseye.add(make_frame(-5.0, 0.0, 5.0, taken_at=90.0), one_colour((90, 90, 90)))
    west, east = (grid.rows // 2, grid.columns // 4), (grid.rows // 2, 3 * grid.columns // 4)
    assert birdseye.covered[west]
    assert not birdseye.covered[east]
    assert birdseye.ages(100.0)[west] == pytest.approx(10.0)
    assert np.isinf(birdseye.ages(100.0)[east])


def test_the_same_picture_again_changes_nothing_but_its_age(
    grid: Grid, make_frame: MakeFrame, one_colour: OneColour
) -> None:
    """So a quiet site costs nothing."""
    birdseye = BirdsEye(grid)
    assert birdseye.add(make_frame(taken_at=90.0), one_colour((90, 90, 90)))
    assert not birdseye.add(make_frame(taken_at=95.0), one_colour((90, 90, 90)))
    assert birdseye.ages(100.0)[grid.rows // 2, grid.columns // 2] == pytest.approx(5.0)
    assert birdseye.add(make_frame(taken_at=96.0), one_colour((120, 90, 90)))


def test_a_camera_that_moved_is_laid_out_anew(grid: Grid, make_frame: MakeFrame, one_colour: OneColour) -> None:
    """Ground that it left is no longer covered."""
    birdseye = BirdsEye(grid)
    birdseye.add(make_frame(-7.0, 0.0, 4.0), one_colour((90, 90, 90)))
    birdseye.add(make_frame(7.0, 0.0, 4.0), one_colour((90, 90, 90)))
    assert not birdseye.covered[grid.rows // 2, : grid.columns // 2].any()
    assert birdseye.covered[grid.rows // 2, -30]


def test_a_silent_camera_gives_way_where_another_one_looks(
    grid: Grid, make_frame: MakeFrame, one_colour: OneColour
) -> None:
    """Elsewhere its last picture stays, with its age."""
    birdseye = BirdsEye(grid)
    birdseye.add(make_frame(0.0, 0.0, 10.0, camera_id="old", taken_at=100.0), one_colour((200, 0, 0)))
    birdseye.add(make_frame(3.0, 0.0, 6.0, camera_id="new", taken_at=101.0), one_colour((0, 0, 200)))
    middle = (grid.rows // 2, round(grid.to_cells(np.array([[0.5, 0.0]]))[0, 0]))
    assert birdseye.picture[middle][0] > 150
    birdseye.add(make_frame(3.0, 0.0, 6.0, camera_id="new", taken_at=130.0), one_colour((0, 0, 200)))
    assert birdseye.yield_stale()
    assert birdseye.picture[middle][2] > 150
    far_west = (grid.rows // 2, round(grid.to_cells(np.array([[-4.0, 0.0]]))[0, 0]))
    assert birdseye.picture[far_west][0] > 150
    assert not birdseye.yield_stale()


def test_a_camera_that_sees_none_of_the_site_is_refused(
    grid: Grid, make_frame: MakeFrame, one_colour: OneColour
) -> None:
    """And leaves the mosaic as it was."""
    birdseye = BirdsEye(grid)
    with pytest.raises(FrameError, match="no ground"):
        birdseye.add(make_frame(500.0, 0.0), one_colour((90, 90, 90)))
    assert not birdseye.layers


def test_windows_are_cut_off_at_the_grids_edge(grid: Grid) -> None:
    """However far a place lies outside."""
    assert grid.around(np.array([[-9.9, 4.9]]), 1.0) == Window(0, 0, 12, 12)
    assert grid.around(np.array([[99.0, 0.0]]), 1.0).size[1] == 0
