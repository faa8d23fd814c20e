"""What changed, and selective search."""

import numpy as np
import pytest
from muster_vision import regions
from muster_vision.birdseye import Grid, Window
from muster_vision.camera import Picture


@pytest.fixture
def plain(grid: Grid) -> Picture:
    """Provide a view of noisy ground."""
    rng = np.random.default_rng(0)
    return (np.array([170, 155, 130]) + rng.normal(0, 4, (grid.rows, grid.columns, 3))).clip(0, 255).astype(np.uint8)


def with_block(picture: Picture, window: Window) -> Picture:
    """Return the view with something dark in a window."""
    changed = picture.copy()
    changed[window.cells] = (60, 70, 120)
    return changed


def test_noise_is_no_change(grid: Grid, plain: Picture) -> None:
    """A JPEG of the same scene differs by a few levels everywhere."""
    noise = np.random.default_rng(1).normal(0, 3, plain.shape)
    assert not regions.changed(plain, (plain + noise).clip(0, 255).astype(np.uint8), grid.cell_m).any()


def test_what_appears_is_a_change_where_it_is(grid: Grid, plain: Picture) -> None:
    """And nowhere else."""
    window = Window(30, 50, 45, 70)
    changed = regions.changed(plain, with_block(plain, window), grid.cell_m)
    assert changed[window.cells].mean() > 0.9
    changed[28:47, 48:72] = False
    assert not changed.any()


def test_windows_hold_all_that_is_marked_and_never_touch(grid: Grid) -> None:
    """Marks that lie near each other share one."""
    mask = np.zeros((grid.rows, grid.columns), np.bool_)
    mask[20, 30] = mask[25, 38] = mask[80, 180] = True
    found = regions.windows(mask, grid, margin_m=1.0)
    assert len(found) == 2
    assert not found[0].touches(found[1])
    left = np.ones_like(mask)
    for window in found:
        left[window.cells] = False
    assert not (mask & left).any()


def test_nothing_marked_needs_no_window(grid: Grid) -> None:
    """So nothing is searched."""
    assert regions.windows(np.zeros((grid.rows, grid.columns), np.bool_), grid) == []


def test_selective_search_proposes_what_stands_out(grid: Grid, plain: Picture) -> None:
    """A frame that nearly fits is among the proposals."""
    thing = Window(40, 60, 58, 80)
    proposed = regions.propose(with_block(plain, thing), grid.whole, grid)
    assert max(regions.overlap(thing, region) for region in proposed) > 0.7


def test_a_region_that_ends_where_the_search_did_is_not_proposed(grid: Grid, plain: Picture) -> None:
    """It is part of something larger; at the edge of the view it may be all there is to see."""
    picture = with_block(plain, Window(0, 60, 58, 80))
    inside = Window(20, 40, 80, 100)
    assert all(region.top > inside.top for region in regions.propose(picture, inside, grid))
    to_the_edge = Window(0, 40, 80, 100)
    assert any(region.top == 0 for region in regions.propose(picture, to_the_edge, grid))


def test_overlap_is_intersection_over_union() -> None:
    """Nothing in common is 0, the same is 1."""
    assert regions.overlap(Window(0, 0, 10, 10), Window(0, 5, 10, 15)) == pytest.approx(1 / 3)
    assert regions.overlap(Window(0, 0, 10, 10), Window(20, 0, 30, 10)) == 0.0
    assert regions.overlap(Window(0, 0, 10, 10), Window(0, 0, 10, 10)) == 1.0
