"""The one place that talks to pybullet: bodies with shapes and joints, distances between hulls, pictures.

pybullet's own dynamics are not stepped: machines are moved kinematically (see `world`), pybullet
keeps the bodies, their joints, their collision shapes and renders them.
"""

import importlib
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .meshes import Mesh
from .textures import Picture

# pybullet has no type stubs; nothing untyped leaves this module
_bullet: Final[Any] = importlib.import_module("pybullet")

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Colour = tuple[float, float, float]

FLAT: Final[Quaternion] = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Part:
    """A coloured box of a machine: its size along x, y, z and its centre in the link's frame, in metres."""

    size: Vector
    centre: Vector
    colour: Colour
    pitch: float = 0.0
    """About y, in radians; positive lifts what points forward."""


@dataclass(frozen=True)
class Link:
    """A moving part: its joint's place in the parent's frame and its axis (a unit vector), and its boxes."""

    parent: int
    """Number of the link that carries it, from 1; 0 is the base."""
    at: Vector
    axis: Vector
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Hull:
    """A solid that others cannot enter: a box (half sizes x, y and height) or, with `round`, a cylinder."""

    half_x: float
    half_y: float
    height: float
    round: bool = False


def yaw_quaternion(yaw: float) -> Quaternion:
    """Return the turn by `yaw` radians about the vertical."""
    return (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


class Scene:
    """A headless pybullet world. Body numbers are its own handles; close it or use it with `with`."""

    def __init__(self) -> None:
        self._client: int = _bullet.connect(_bullet.DIRECT)

    def close(self) -> None:
        """Free everything. Closing twice is fine."""
        if self._client >= 0:
            _bullet.disconnect(physicsClientId=self._client)
            self._client = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def texture(self, picture: Picture) -> int:
        """Return the handle of a surface picture."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "surface.bmp"
            Image.fromarray(picture).save(path)
            return _bullet.loadTexture(str(path), physicsClientId=self._client)

    def mesh_shape(self, mesh: Mesh) -> int:
        """Return the handle of a shape that any number of bodies may show."""
        return _bullet.createVisualShape(
            _bullet.GEOM_MESH,
            vertices=mesh.vertices.tolist(),
            indices=mesh.triangles.ravel().tolist(),
            normals=mesh.normals.tolist(),
            uvs=mesh.uvs.tolist(),
            rgbaColor=[1, 1, 1, 1],
            physicsClientId=self._client,
        )

    def hull_shape(self, hull: Hull) -> int:
        """Return the handle of a solid that any number of bodies may have."""
        centre = [0, 0, hull.height / 2]
        if hull.round:
            return _bullet.createCollisionShape(
                _bullet.GEOM_CYLINDER,
                radius=hull.half_x,
                height=hull.height,
                collisionFramePosition=centre,
                physicsClientId=self._client,
            )
        return _bullet.createCollisionShape(
            _bullet.GEOM_BOX,
            halfExtents=[hull.half_x, hull.half_y, hull.height / 2],
            collisionFramePosition=centre,
            physicsClientId=self._client,
        )

    def add(self, shape: int, texture: int, hull: int = -1) -> int:
        """Add a single body at the origin and return its handle."""
        body = _bullet.createMultiBody(0, hull, shape, physicsClientId=self._client)
        _bullet.changeVisualShape(body, -1, textureUniqueId=texture, physicsClientId=self._client)
        return body

    def add_machine(self, base: Sequence[Part], links: Sequence[Link], hull: Hull) -> int:
        """Add a body with joints at the origin, its base solid as `hull`, and return its handle."""
        count = len(links)
        return _bullet.createMultiBody(
            0,
            self.hull_shape(hull),
            self._parts_shape(base),
            linkMasses=[0] * count,
            linkCollisionShapeIndices=[-1] * count,
            linkVisualShapeIndices=[self._parts_shape(link.parts) for link in links],
            linkPositions=[link.at for link in links],
            linkOrientations=[FLAT] * count,
            linkInertialFramePositions=[(0, 0, 0)] * count,
            linkInertialFrameOrientations=[FLAT] * count,
            linkParentIndices=[link.parent for link in links],
            linkJointTypes=[_bullet.JOINT_REVOLUTE] * count,
            linkJointAxis=[link.axis for link in links],
            physicsClientId=self._client,
        )

    def remove(self, body: int) -> None:
        """Take a body out of the world."""
        _bullet.removeBody(body, physicsClientId=self._client)

    def place(self, body: int, position: Vector, orientation: Quaternion) -> None:
        """Put a body somewhere at once."""
        _bullet.resetBasePositionAndOrientation(body, position, orientation, physicsClientId=self._client)

    def set_joint(self, body: int, joint: int, angle: float) -> None:
        """Turn a joint (numbered from 0 in the order of the links) to an angle at once."""
        _bullet.resetJointState(body, joint, angle, physicsClientId=self._client)

    def link_pose(self, body: int, joint: int) -> tuple[Vector, Quaternion]:
        """Return where a link's joint frame is in the world."""
        state = _bullet.getLinkState(body, joint, computeForwardKinematics=1, physicsClientId=self._client)
        return state[4], state[5]

    def distance(self, first: int, second: int, within: float) -> float:
        """Return the distance between two hulls in metres, negative when they overlap, at most `within`."""
        points = _bullet.getClosestPoints(
            first, second, within, linkIndexA=-1, linkIndexB=-1, physicsClientId=self._client
        )
        return min((point[8] for point in points), default=within)

    def picture(
        self, size: tuple[int, int], view: Sequence[float], projection: Sequence[float], light: Vector
    ) -> tuple[Picture, NDArray[np.float32]]:
        """Return colours (height, width, 3) and the depth buffer (height, width; 0 to 1) of a camera.

        Args:
            size: width and height in pixels.
            view: OpenGL view matrix, column by column.
            projection: OpenGL projection matrix, column by column.
            light: where the light comes from.

        """
        width, height = size
        _, _, colours, depth, _ = _bullet.getCameraImage(
            width,
            height,
            view,
            projection,
            lightDirection=light,
            lightDistance=100,
            shadow=0,
            lightAmbientCoeff=0.55,
            lightDiffuseCoeff=0.5,
            lightSpecularCoeff=0.0,
            renderer=_bullet.ER_TINY_RENDERER,
            flags=_bullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=self._client,
        )
        rgb = np.asarray(colours, dtype=np.uint8).reshape(height, width, 4)[..., :3]
        return rgb, np.asarray(depth, dtype=np.float32).reshape(height, width)

    def _parts_shape(self, parts: Sequence[Part]) -> int:
        return _bullet.createVisualShapeArray(
            shapeTypes=[_bullet.GEOM_BOX] * len(parts),
            halfExtents=[[s / 2 for s in part.size] for part in parts],
            visualFramePositions=[part.centre for part in parts],
            visualFrameOrientations=[(0, -math.sin(p.pitch / 2), 0, math.cos(p.pitch / 2)) for p in parts],
            rgbaColors=[[*part.colour, 1] for part in parts],
            physicsClientId=self._client,
        )
