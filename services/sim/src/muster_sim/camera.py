"""Pinhole cameras that look down from above: matrices for the renderer, pose and intrinsics for the receiver."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from muster_schemas.site import Camera
from muster_schemas.world import CameraFrame
from numpy.typing import NDArray

from .textures import Picture

NEAR_M: Final = 1.0
HORIZON: Final = np.array([222.0, 226.0, 224.0])
ZENITH: Final = np.array([138.0, 172.0, 208.0])

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pinhole:
    """A camera's geometry. Axes: x right, y down, z forward; pixel (0, 0) is the middle of the top left pixel."""

    width: int
    height: int
    focal_px: float
    position: Floats
    rotation: Floats
    """(3, 3); turns camera axes into the site's."""

    @property
    def centre_px(self) -> tuple[float, float]:
        """Where the optical axis meets the picture, as (x, y).

        The renderer samples at the corners of its pixels, counted from the bottom left, not in their middles: so it is
        half a pixel to the right of the middle and half a pixel above it.
        """
        return self.width / 2, self.height / 2 - 1

    @property
    def far_m(self) -> float:
        """Beyond this nothing is drawn."""
        return 4.0 * float(self.position[2]) + 50.0

    def view_matrix(self) -> list[float]:
        """Return the OpenGL view matrix, column by column (OpenGL: y up, z backward)."""
        rotation = np.diag([1.0, -1.0, -1.0]) @ self.rotation.T
        matrix = np.eye(4)
        matrix[:3, :3] = rotation
        matrix[:3, 3] = -rotation @ self.position
        return matrix.T.ravel().tolist()

    def projection_matrix(self) -> list[float]:
        """Return the OpenGL projection matrix, column by column."""
        near, far = NEAR_M, self.far_m
        matrix = np.zeros((4, 4))
        matrix[0, 0] = 2 * self.focal_px / self.width
        matrix[1, 1] = 2 * self.focal_px / self.height
        matrix[2, 2] = -(far + near) / (far - near)
        matrix[2, 3] = -2 * far * near / (far - near)
        matrix[3, 2] = -1
        return matrix.T.ravel().tolist()

    def depth_m(self, buffer: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return metres along the optical axis from the renderer's depth buffer."""
        near, far = NEAR_M, self.far_m
        return (far * near / (far - (far - near) * buffer)).astype(np.float32)

    def project(self, points: Floats) -> Floats:
        """Return the pixels (n, 2) of site points (n, 3) that lie before the camera."""
        x, y, z = ((points - self.position) @ self.rotation).T
        cx, cy = self.centre_px
        return np.stack([cx + self.focal_px * x / z, cy + self.focal_px * y / z], axis=-1)

    def frame(self, camera_id: str, seq: int, taken_at: float) -> CameraFrame:
        """Return what goes with a picture on the bus."""
        cx, cy = self.centre_px
        return CameraFrame(
            camera_id=camera_id,
            seq=seq,
            taken_at=taken_at,
            width_px=self.width,
            height_px=self.height,
            fx_px=self.focal_px,
            fy_px=self.focal_px,
            cx_px=cx,
            cy_px=cy,
            x_m=float(self.position[0]),
            y_m=float(self.position[1]),
            z_m=float(self.position[2]),
            orientation=_quaternion(self.rotation),
        )


def pinhole(camera: Camera) -> Pinhole:
    """Return the geometry of a site's camera; one that looks straight down has north at its top."""
    position = np.array([camera.position.x, camera.position.y, camera.height_m])
    target = camera.look_at or camera.position
    forward = np.array([target.x, target.y, 0.0]) - position
    forward /= np.linalg.norm(forward)
    sideways = np.array([-forward[1], forward[0]])
    # looking straight down, "up" gives no sideways direction
    right = np.array([1.0, 0.0, 0.0])
    if np.linalg.norm(sideways) > 1e-6:
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    focal = camera.height_px / 2 / math.tan(math.radians(camera.field_of_view_deg) / 2)
    return Pinhole(camera.width_px, camera.height_px, focal, position, rotation)


def _quaternion(r: Floats) -> tuple[float, float, float, float]:
    """Return (x, y, z, w) of a rotation matrix (Shepperd's method: divide by the largest component)."""
    squares = np.array([1 + r[0, 0] - r[1, 1] - r[2, 2], 1 - r[0, 0] + r[1, 1] - r[2, 2],
                        1 - r[0, 0] - r[1, 1] + r[2, 2], 1 + r[0, 0] + r[1, 1] + r[2, 2]])  # fmt: skip
    biggest = int(np.argmax(squares))
    a = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
    s = [r[1, 0] + r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2]]
    rows = ([squares[0], s[0], s[1], a[0]], [s[0], squares[1], s[2], a[1]],
            [s[1], s[2], squares[2], a[2]], [a[0], a[1], a[2], squares[3]])  # fmt: skip
    x, y, z, w = np.array(rows[biggest]) / (2 * math.sqrt(squares[biggest]))
    return float(x), float(y), float(z), float(w)


def shaded(colours: Picture, depth: NDArray[np.float32], lens: Pinhole, light: Floats) -> Picture:
    """Return the picture with the shadows that things cast, and with a sky where there is nothing.

    The renderer's own shadows reach only a few metres around the origin, so they come from the depth picture: a point
    is in shadow if, some way towards the light, something stands before that place as the camera sees it.

    Args:
        colours: (height, width, 3).
        depth: (height, width), metres along the optical axis.
        lens: the camera.
        light: (3,), unit vector towards the light.

    """
    towards = (lens.rotation.T @ light).astype(np.float32)
    cx, cy = lens.centre_px
    v, u = np.indices(depth.shape, dtype=np.float32)
    right, down = (u - cx) / lens.focal_px, (v - cy) / lens.focal_px
    dark = np.zeros(depth.shape, dtype=bool)
    # a finer picture shows the gaps between coarse steps
    coarseness = float(np.median(depth)) / lens.focal_px
    for step in np.geomspace(0.2, 4.0, int(np.clip(1 / coarseness, 9, 32))).astype(np.float32):
        z = depth + step * towards[2]
        scale = lens.focal_px / z
        column = (cx + 0.5 + scale * (right * depth + step * towards[0])).astype(np.int32)
        row = (cy + 0.5 + scale * (down * depth + step * towards[1])).astype(np.int32)
        np.clip(column, 0, lens.width - 1, out=column)
        np.clip(row, 0, lens.height - 1, out=row)
        before = z - depth[row, column]
        dark |= (before > 0.1) & (before < 1.5)
    picture = np.where(dark[..., None], (colours * np.float32(0.62)).astype(np.uint8), colours)
    sky = depth > 0.99 * lens.far_m
    if sky.any():
        rows = np.nonzero(sky)[0]
        height = (1 - rows / max(1, int(rows[-1])))[:, None]
        picture[sky] = HORIZON * (1 - height) + ZENITH * height
    return picture
