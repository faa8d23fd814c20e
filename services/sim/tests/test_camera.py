"""Pictures are those of the pinhole camera that goes with them, and show the amounts that are there."""

import math

import numpy as np
import pytest
from muster_schemas.site import Camera
from muster_schemas.world import CameraFrame
from muster_sim.camera import pinhole
from muster_sim.testing import Operator, small_site
from muster_sim.world import World
from numpy.typing import NDArray

DOWN = {"id": "down", "position": {"x": 2, "y": -3}, "height_m": 30, "width_px": 320, "height_px": 240}
TILTED = {**DOWN, "id": "tilted", "look_at": {"x": 14, "y": 6}, "height_m": 20, "field_of_view_deg": 50}


def pixels(frame: CameraFrame, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Project site points (n, 3) with nothing but what the frame says, into (n, 2)."""
    x, y, z, w = frame.orientation
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    seen = (points - np.array([frame.x_m, frame.y_m, frame.z_m])) @ turn
    return np.stack(
        [
            frame.cx_px + frame.fx_px * seen[:, 0] / seen[:, 2],
            frame.cy_px + frame.fy_px * seen[:, 1] / seen[:, 2],
        ],
        axis=-1,
    )


def middle_of(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the mean pixel (x, y) of a mask."""
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean(), rows.mean()])


def water(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return where a picture is blue."""
    red, _, blue = (picture[..., i].astype(int) for i in range(3))
    return blue > red + 10


@pytest.mark.parametrize("spec", [DOWN, TILTED], ids=["straight down", "tilted"])
@pytest.mark.parametrize("place", [(8, 4), (12, -2)])
def test_a_thing_is_where_the_frame_says(spec: dict[str, object], place: tuple[float, float]) -> None:
    """The middle of a puddle lies within half a pixel of its projection."""
    puddle = {"name": "puddle1", "class": "puddle", "position": {"x": place[0], "y": place[1]}, "radius_m": 0.8}
    camera = Camera.model_validate(spec)
    with World(small_site({"far": ("dump_truck", -28, 28, 0)}, [puddle])) as world:
        picture = world.render(camera)
    frame = pinhole(camera).frame("down", 0, 0.0)
    expected = pixels(frame, np.array([[*place, 0.03]]))[0]
    assert picture.shape == (240, 320, 3)
    assert middle_of(water(picture)) == pytest.approx(expected, abs=0.4)


def test_looking_straight_down_has_north_up_and_east_right() -> None:
    """The middle of the picture is below the camera."""
    frame = pinhole(Camera.model_validate(DOWN)).frame("down", 0, 0.0)
    below, north, east = pixels(frame, np.array([[2.0, -3, 0], [2, 0, 0], [5, -3, 0]]))
    assert below == pytest.approx([159.5, 119.5], abs=0.51)
    assert north[1] < below[1]
    assert east[0] > below[0]


def test_the_field_of_view_is_vertical() -> None:
    """A point at its upper edge is projected onto the picture's upper edge."""
    frame = pinhole(Camera.model_validate(DOWN)).frame("down", 0, 0.0)
    edge = pixels(frame, np.array([[2.0, -3 + 30 * math.tan(math.radians(30)), 0]]))[0]
    assert edge[1] == pytest.approx(-0.5, abs=0.51)


def brown(picture: NDArray[np.uint8]) -> int:
    """Return how many pixels around the middle show soil."""
    red, green, blue = (picture[80:160, 120:200, i].astype(int) for i in range(3))
    return int(((red > 1.25 * green) & (green > 1.15 * blue) & (red < 190) & (blue < 80)).sum())


def test_a_pile_looks_smaller_when_soil_is_taken() -> None:
    """Its visible area follows its amount."""
    pile = {"name": "soil1", "class": "soil", "position": {"x": 5, "y": 0}, "radius_m": 2.4, "soil_m3": 4}
    camera = Camera.model_validate({**DOWN, "position": {"x": 5, "y": 0}})
    with World(small_site({"digger": ("excavator", 0, 0, 0)}, [pile])) as world:
        full = brown(world.render(camera))
        operator = Operator(world)
        for _ in range(6):
            operator.dig("digger")
            operator.unload("digger", 3.0)
        operator.reach("digger", swing=3.0)
        rest = brown(world.render(camera))
    assert full > 500
    assert rest / full == pytest.approx((1 / 4) ** (2 / 3), rel=0.15)


def test_a_carried_rock_is_seen_in_the_bucket() -> None:
    """It is no longer where it lay."""
    rock = {"name": "obstacle1", "class": "obstacle", "position": {"x": 5, "y": 0}, "radius_m": 0.8, "height_m": 0.8}
    camera = Camera.model_validate({**DOWN, "position": {"x": 0, "y": 0}, "height_m": 20})
    with World(small_site({"digger": ("excavator", 0, 0, 0)}, [rock])) as world:
        operator = Operator(world)
        operator.dig("digger")
        operator.reach("digger", swing=math.pi / 2)
        picture = world.render(camera).astype(int)
    orange = (picture[..., 0] > 180) & (picture[..., 1] < 130) & (picture[..., 2] < 70)
    assert orange.sum() > 5
    x, y = middle_of(orange)
    assert (x, y) == (pytest.approx(159.5, abs=12), pytest.approx(119.5 - 4.6 * 10.4 * 20 / 17, abs=16))
