"""Triangle meshes of what lies on a site. Unit sizes; the scene scales and places them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Mesh:
    """Vertices (n, 3) in metres, outward normals (n, 3), texture coordinates (n, 2), and triangles (m, 3)."""

    vertices: Floats
    normals: Floats
    uvs: Floats
    triangles: NDArray[np.int64]

    def scaled(self, x: float, y: float, z: float) -> "Mesh":
        """Return the mesh stretched along its axes."""
        scale = np.array([x, y, z])
        normals = self.normals / scale
        return Mesh(self.vertices * scale, normals / _length(normals), self.uvs, self.triangles)


def plane(half_x: float, half_y: float) -> Mesh:
    """Return a rectangle on the ground whose texture covers it once, north up."""
    vertices = np.array([[-half_x, -half_y, 0], [half_x, -half_y, 0], [half_x, half_y, 0], [-half_x, half_y, 0]])
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    return Mesh(vertices.astype(float), normals, uvs.astype(float), np.array([[0, 1, 2], [0, 2, 3]]))


def mound(rng: np.random.Generator) -> Mesh:
    """Return a heap of radius 1 and height 1 that is a little uneven: loose material at rest."""
    rings, sectors = 7, 28
    lobes = _waves(rng, sectors, strength=0.05)
    radius = np.linspace(0, 1, rings + 1)[:, None] * lobes[None, :]
    height = (1 - np.linspace(0, 1, rings + 1) ** 2)[:, None] * (1 + rng.normal(0, 0.05, (rings + 1, sectors)))
    height[0] = height[0].mean()
    height[-1] = 0.0
    return _from_rings(radius, height)


def pool(rng: np.random.Generator) -> Mesh:
    """Return a flat shape of radius 1 with a wavy shore."""
    sectors = 36
    shore = _waves(rng, sectors, strength=0.1)
    return _from_rings(np.stack([np.zeros(sectors), shore]), np.zeros((2, sectors)))


def boulder(rng: np.random.Generator) -> Mesh:
    """Return a rock of radius 1 that stands 1 high, with flat facets."""
    rings, sectors = 5, 9
    angle = np.linspace(np.pi / 2, 0, rings + 1)[:, None]
    bulge = rng.uniform(0.72, 1.0, (rings + 1, sectors))
    bulge[0] = bulge[0].mean()
    return _faceted(_from_rings(np.cos(angle) * bulge, np.sin(angle) * bulge))


def block() -> Mesh:
    """Return a box from -1 to 1 in x and y and 0 to 1 in z; every face shows the whole texture."""
    vertices: list[list[float]] = []
    normals: list[list[float]] = []
    triangles: list[list[int]] = []
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    faces = [
        [(*corners[i], 0), (*corners[(i + 1) % 4], 0), (*corners[(i + 1) % 4], 1), (*corners[i], 1)] for i in range(4)
    ]
    outward = [(0, -1, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0)]
    faces.append([(*c, 1) for c in corners])
    outward.append((0, 0, 1))
    for face, normal in zip(faces, outward, strict=True):
        start = len(vertices)
        vertices += [list(map(float, v)) for v in face]
        normals += [list(map(float, normal))] * 4
        triangles += [[start, start + 1, start + 2], [start, start + 2, start + 3]]
    uvs = np.tile([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], (len(faces), 1))
    return Mesh(np.array(vertices), np.array(normals), uvs, np.array(triangles))


def _waves(rng: np.random.Generator, sectors: int, strength: float) -> Floats:
    """Return radii, the largest 1, that vary smoothly around the circle and leave the area's middle at the origin."""
    angle = np.linspace(0, 2 * np.pi, sectors, endpoint=False)
    radius = np.ones(sectors)
    for k in (2, 3, 4, 5):
        radius += rng.normal(0, strength / k) * np.cos(k * angle + rng.uniform(0, 2 * np.pi))
    # a first harmonic moves the middle; a few rounds are enough for it to cancel what the others did
    for _ in range(8):
        middle = (radius**3 * np.exp(1j * angle)).sum() / (1.5 * (radius**2).sum())
        radius -= (middle * np.exp(-1j * angle)).real
    return radius / radius.max()


def _from_rings(radius: Floats, height: Floats) -> Mesh:
    """Return the surface through rings of points, the first ring being the centre (all arrays: rings x sectors)."""
    rings, sectors = radius.shape
    angle = np.linspace(0, 2 * np.pi, sectors, endpoint=False)[None, :]
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1).reshape(-1, 3)
    index: NDArray[np.int64] = np.arange(rings * sectors, dtype=np.int64).reshape(rings, sectors)
    inner, outer = index[:-1], index[1:]
    inner_next, outer_next = np.roll(inner, -1, axis=1), np.roll(outer, -1, axis=1)
    triangles = np.concatenate(
        [
            np.stack([inner, outer, outer_next], axis=-1).reshape(-1, 3),
            np.stack([inner, outer_next, inner_next], axis=-1).reshape(-1, 3),
        ]
    )
    normals = np.zeros_like(vertices)
    faces = _face_normals(vertices, triangles)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], faces)
    # the centre is one place with many vertices: they share one normal
    normals[:sectors] = normals[:sectors].sum(axis=0)
    return Mesh(vertices, normals / _length(normals), vertices[:, :2] / 2 + 0.5, triangles)


def _faceted(mesh: Mesh) -> Mesh:
    """Return the mesh with a flat normal per triangle."""
    vertices = mesh.vertices[mesh.triangles].reshape(-1, 3)
    triangles = np.arange(len(vertices)).reshape(-1, 3)
    normals = np.repeat(_face_normals(vertices, triangles), 3, axis=0)
    return Mesh(vertices, normals / _length(normals), vertices[:, :2] / 2 + 0.5, triangles)


def _face_normals(vertices: Floats, triangles: NDArray[np.int64]) -> Floats:
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def _length(vectors: Floats) -> Floats:
    return np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
