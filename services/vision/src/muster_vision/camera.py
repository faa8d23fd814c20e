"""A pinhole camera above the ground plane, and the frames that it delivers.

Image coordinates are those of OpenCV: (0, 0) is the middle of the upper-left pixel, so a centred optical axis is at
((width - 1) / 2, (height - 1) / 2). Ground coordinates are the site's x and y at z = 0.
"""

import io
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
from muster_schemas.world import CameraFrame
from PIL import Image

Floats = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]

MAX_PIXELS = 4096 * 4096
MAX_BYTES = 16 * 1024 * 1024


class FrameError(ValueError):
    """A frame that cannot be used; the message says why."""


@dataclass(frozen=True)
class View:
    """Where a camera is and how it projects."""

    matrix: Floats
    """3 x 3 intrinsics, pixels."""
    rotation: Floats
    """3 x 3, turns camera axes (x right, y down, z forward) into the site's."""
    centre: Floats
    """The camera's place in the site, metres."""
    width_px: int
    height_px: int

    @classmethod
    def of_frame(cls, frame: CameraFrame) -> Self:
        """Return the view that a frame's attachment describes.

        Raises:
            FrameError: the orientation is no rotation.

        """
        return cls(
            matrix=np.array(
                [[frame.fx_px, 0.0, frame.cx_px], [0.0, frame.fy_px, frame.cy_px], [0.0, 0.0, 1.0]], dtype=np.float64
            ),
            rotation=_rotation(frame.orientation),
            centre=np.array([frame.x_m, frame.y_m, frame.z_m], dtype=np.float64),
            width_px=frame.width_px,
            height_px=frame.height_px,
        )

    @property
    def ground_to_image(self) -> Floats:
        """The homography (3 x 3) from ground (x, y, 1) to image (u w, v w, w); w is the depth in metres."""
        turned = self.rotation.T
        return self.matrix @ np.column_stack([turned[:, 0], turned[:, 1], -turned @ self.centre])

    def project(self, points: Floats) -> Floats:
        """Return image coordinates (N, 2) of site points (N, 3); NaN for those behind the camera."""
        in_camera = (points - self.centre) @ self.rotation
        image = in_camera @ self.matrix.T
        depth = np.where(image[:, 2] > 1e-6, image[:, 2], np.nan)
        return image[:, :2] / depth[:, None]

    def ground(self, pixels: Floats) -> Floats:
        """Return ground coordinates (N, 2) of image points (N, 2); NaN where the ray never meets the ground."""
        homogeneous = np.column_stack([pixels, np.ones(len(pixels))])
        rays = homogeneous @ np.linalg.inv(self.matrix).T @ self.rotation.T
        down = np.where(rays[:, 2] < -1e-9, -rays[:, 2], np.nan)
        return self.centre[:2] + rays[:, :2] * (self.centre[2] / down)[:, None]

    def sight(self, point: Floats) -> tuple[Floats, float]:
        """Return how a ground point (2,) is seen: the unit vector away from the camera's foot, and tan of the angle.

        A top at height h above the point appears shifted by about h times the tangent along that vector.
        """
        offset = point - self.centre[:2]
        distance = float(np.hypot(offset[0], offset[1]))
        if distance < 1e-6:
            return np.array([1.0, 0.0]), 0.0
        return offset / distance, distance / float(self.centre[2])

    def same_as(self, other: Self) -> bool:
        """Whether both look at the same place from the same place (to a millimetre and a 0.006 of a degree)."""
        return (
            (self.width_px, self.height_px) == (other.width_px, other.height_px)
            and np.allclose(self.matrix, other.matrix, rtol=0, atol=1e-3)
            and np.allclose(self.rotation, other.rotation, rtol=0, atol=1e-4)
            and np.allclose(self.centre, other.centre, rtol=0, atol=1e-3)
        )


def decode(frame: CameraFrame, jpeg: bytes) -> Picture:
    """Return the picture of a frame, (height, width, 3), RGB.

    Raises:
        FrameError: it is no whole JPEG, or its size is absurd or not the one in the attachment.

    """
    if len(jpeg) > MAX_BYTES or frame.width_px * frame.height_px > MAX_PIXELS:
        raise FrameError(
            f"{len(jpeg)} bytes for {frame.width_px} x {frame.height_px} pixels; at most {MAX_BYTES} bytes and "
            f"{MAX_PIXELS} pixels are taken"
        )
    try:
        # The header is read first, so a small file that claims a huge picture is never unpacked.
        with Image.open(io.BytesIO(jpeg), formats=["JPEG"]) as image:
            if image.size != (frame.width_px, frame.height_px):
                raise FrameError(
                    f"the JPEG has {image.size[0]} x {image.size[1]} pixels, its attachment says "
                    f"{frame.width_px} x {frame.height_px}"
                )
            return np.asarray(image.convert("RGB"), dtype=np.uint8)
    except (OSError, SyntaxError, Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise FrameError(f"no whole JPEG: {error}") from error


def _rotation(quaternion: tuple[float, float, float, float]) -> Floats:
    norm = math.sqrt(sum(q * q for q in quaternion))
    if not 0.99 < norm < 1.01:
        raise FrameError(f"the orientation is no unit quaternion (its norm is {norm:.3f})")
    x, y, z, w = (q / norm for q in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ],
        dtype=np.float64,
    )
