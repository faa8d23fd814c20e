"""The pinhole camera, and what is no frame."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from muster_schemas.site import Camera
from muster_schemas.world import CameraFrame
from muster_sim.camera import pinhole
from muster_vision.camera import FrameError, View, decode

MakeFrame = Callable[..., CameraFrame]


def test_a_camera_that_looks_down_sees_north_above_and_east_on_the_right(make_frame: MakeFrame) -> None:
    """A metre at 10 m distance is a tenth of the focal length."""
    frame = make_frame(3.0, 2.0, 10.0)
    middle, east, north = View.of_frame(frame).project(np.array([[3.0, 2.0, 0.0], [4.0, 2.0, 0.0], [3.0, 3.0, 0.0]]))
    assert middle == pytest.approx([frame.cx_px, frame.cy_px])
    assert east - middle == pytest.approx([frame.fx_px / 10, 0.0])
    assert north - middle == pytest.approx([0.0, -frame.fy_px / 10])


@pytest.mark.parametrize("look_at", [None, {"x": 4.0, "y": 9.0}, {"x": -12.0, "y": 1.0}])
def test_the_homography_and_its_inverse_agree_with_the_simulators_camera(look_at: dict[str, float] | None) -> None:
    """Tilted or not, points on the ground land where the renderer's own projection puts them."""
    camera = Camera.model_validate({"id": "c", "position": {"x": 1, "y": -2}, "height_m": 20, "look_at": look_at})
    lens = pinhole(camera)
    view = View.of_frame(lens.frame("c", 0, 0.0))
    ground = np.array([[0.0, 0.0], [3.0, -4.0], [-2.0, 5.0]])
    at_height_0 = np.column_stack([ground, np.zeros(3)])
    pixels = lens.project(at_height_0)
    homogeneous = np.column_stack([ground, np.ones(3)]) @ view.ground_to_image.T
    assert homogeneous[:, :2] / homogeneous[:, 2:] == pytest.approx(pixels)
    assert view.project(at_height_0) == pytest.approx(pixels)
    assert view.ground(pixels) == pytest.approx(ground)


def test_a_ray_above_the_horizon_meets_no_ground(make_frame: MakeFrame) -> None:
    """A camera that looks north to the horizon sees ground only in its lower half."""
    # turned by 90 degrees about x from looking down
    half = math.sqrt(0.5)
    view = View.of_frame(make_frame(orientation=(half * -1.0, 0.0, 0.0, half)))
    above, below = view.ground(np.array([[99.5, 20.0], [99.5, 180.0]]))
    assert np.isnan(above).all()
    assert below[1] > 0


def test_a_point_behind_the_camera_has_no_place_in_the_picture(make_frame: MakeFrame) -> None:
    """It would otherwise appear mirrored."""
    view = View.of_frame(make_frame())
    assert np.isnan(view.project(np.array([[0.0, 0.0, 15.0]]))).all()


def test_a_top_leans_away_from_the_foot_of_the_camera(make_frame: MakeFrame) -> None:
    """By its height times the tangent of the angle from the vertical."""
    away, tangent = View.of_frame(make_frame(0.0, 0.0, 10.0)).sight(np.array([3.0, 4.0]))
    assert away == pytest.approx([0.6, 0.8])
    assert tangent == pytest.approx(0.5)


def test_an_orientation_that_is_no_rotation_is_refused(make_frame: MakeFrame) -> None:
    """A quaternion of length 2, say."""
    with pytest.raises(FrameError, match="quaternion"):
        View.of_frame(make_frame(orientation=(2.0, 0.0, 0.0, 0.0)))


def test_a_truncated_jpeg_is_refused(make_frame: MakeFrame, one_colour: Callable[..., bytes]) -> None:
    """OpenCV would fill the rest with grey and say nothing."""
    with pytest.raises(FrameError, match="JPEG"):
        decode(make_frame(), one_colour((90, 90, 90))[:-200])


@pytest.mark.parametrize("junk", [b"", b"no picture", b"\x89PNG\r\n\x1a\n" + bytes(50), b"\xff\xd8\xff\xe0" + bytes(9)])
def test_what_is_no_jpeg_is_refused(make_frame: MakeFrame, junk: bytes) -> None:
    """Whatever it is instead."""
    with pytest.raises(FrameError, match="JPEG"):
        decode(make_frame(), junk)


def test_a_picture_of_another_size_than_its_attachment_says_is_refused(
    make_frame: MakeFrame, one_colour: Callable[..., bytes]
) -> None:
    """Its intrinsics would be of another picture."""
    with pytest.raises(FrameError, match="100 x 100"):
        decode(make_frame(), one_colour((90, 90, 90), 100))


def test_an_absurd_size_is_refused_before_anything_is_unpacked(
    make_frame: MakeFrame, one_colour: Callable[..., bytes]
) -> None:
    """Whether the attachment claims it or the JPEG's header does."""
    with pytest.raises(FrameError, match="pixels"):
        decode(make_frame(side=8000), one_colour((90, 90, 90)))
    jpeg = bytearray(one_colour((90, 90, 90)))
    at = jpeg.index(b"\xff\xc0")
    jpeg[at + 5 : at + 9] = b"\xff\xf0\xff\xf0"
    with pytest.raises(FrameError, match=r"65520|JPEG"):
        decode(make_frame(), bytes(jpeg))
