"""What a site looks like: its ground, heaps, things and loads as bodies of the scene, different for every seed."""

import math
from typing import Final

import numpy as np
from muster_schemas.base import Point
from muster_schemas.machines import DUMP_TRUCK
from muster_schemas.site import Bounds

from . import meshes, textures
from .bodies import Body, Form
from .machines.base import Machine
from .machines.dump_truck import DumpTruck
from .machines.excavator import Excavator
from .scene import FLAT, Hull, Quaternion, Scene, Vector, yaw_quaternion
from .soil import Heap

MARGIN_M: Final = 25.0
"""Ground beyond the bounds, so that cameras at the edge see no end of the world."""
HEAP_STEP: Final = 1.04
"""Heaps and loads change their visible size in steps of this ratio; each step's shape is made once and kept."""
WATER_Z_M: Final = 0.03
HIDDEN: Final[Vector] = (0.0, 0.0, -50.0)
LOAD_STEPS: Final = 8


class Appearance:
    """Builds and places everything but the machines' own parts."""

    def __init__(self, scene: Scene, bounds: Bounds, seed: int) -> None:
        self._scene = scene
        self._rng = np.random.default_rng([seed, 7])
        self._soil_texture = scene.texture(textures.soil(self._rng))
        self._mounds = [meshes.mound(self._rng) for _ in range(4)]
        self._shapes: dict[tuple[int, int, int], int] = {}
        self._hulls: dict[tuple[int, int], int] = {}
        self._heaps: dict[int, tuple[int, tuple[int, int, int]]] = {}
        self._loads: dict[str, tuple[int, int]] = {}
        self._add_ground(bounds)

    def add_body(self, body: Body) -> int:
        """Build a thing and return its handle; `place_body` puts it where it is."""
        radius, height = body.radius_m, body.height_m
        if body.form in (Form.POOL, Form.PLATE):
            picture = textures.water(self._rng) if body.form is Form.POOL else self._stranger()
            shape = self._scene.mesh_shape(meshes.pool(self._rng).scaled(radius, radius, 1.0))
            return self._scene.add(shape, self._scene.texture(picture))
        if body.form is Form.BARRIER:
            half_x, half_y = 0.8 * radius, 0.58 * radius
            mesh, picture = meshes.block().scaled(half_x, half_y, height), textures.stripes(self._rng)
            hull = Hull(half_x, half_y, height)
        elif body.form is Form.BOULDER:
            mesh, picture = meshes.boulder(self._rng).scaled(radius, radius, height), textures.stone(self._rng)
            hull = Hull(0.9 * radius, 0.9 * radius, height, round=True)
        else:
            mesh, picture = meshes.block().scaled(0.7 * radius, 0.7 * radius, height), self._stranger()
            hull = Hull(0.7 * radius, 0.7 * radius, height)
        return self._scene.add(self._scene.mesh_shape(mesh), self._scene.texture(picture), self._scene.hull_shape(hull))

    def place_body(self, handle: int, body: Body) -> None:
        """Put a thing where it lies; one that is carried goes out of sight until `show_load` finds it."""
        if body.carrier is not None:
            self._scene.place(handle, HIDDEN, FLAT)
        else:
            height = 0.0 if body.solid else WATER_Z_M
            self._scene.place(handle, (body.x, body.y, height), yaw_quaternion(body.yaw))

    def show_heap(self, heap: Heap) -> int:
        """Show a heap at its present size and return its handle; a site's pile is solid, dropped soil is not."""
        size = round(math.log(max(heap.radius_m, 0.05)) / math.log(HEAP_STEP))
        slope = max(1, round(heap.slope * 20))
        key = (size, slope, heap.number % len(self._mounds))
        handle, shown = self._heaps.get(heap.number, (-1, None))
        if shown == key:
            return handle
        if shown is not None:
            self._scene.remove(handle)
        radius = HEAP_STEP**size
        height = radius * slope / 20
        if key not in self._shapes:
            self._shapes[key] = self._scene.mesh_shape(self._mounds[key[2]].scaled(radius, radius, height))
        hull = -1
        if heap.pile is not None:
            if (size, slope) not in self._hulls:
                self._hulls[size, slope] = self._scene.hull_shape(Hull(radius, radius, height, round=True))
            hull = self._hulls[size, slope]
        handle = self._scene.add(self._shapes[key], self._soil_texture, hull)
        self._scene.place(handle, (heap.x, heap.y, 0.0), yaw_quaternion(heap.number * 2.4))
        self._heaps[heap.number] = (handle, key)
        return handle

    def forget_heaps(self, present: set[int]) -> None:
        """Remove the heaps that are gone."""
        for number in [n for n in self._heaps if n not in present]:
            self._scene.remove(self._heaps.pop(number)[0])

    def show_load(self, machine: Machine, handle: int, bodies: dict[str, int]) -> None:
        """Show what is in a machine's bucket or bed. `handle` is the machine's, `bodies` are the things' by name."""
        if isinstance(machine, DumpTruck):
            at, turn = self._scene.link_pose(handle, 0)
            at = _within(at, turn, (DUMP_TRUCK.bed_length_m / 2, 0.0, 0.02))
            half_x, half_y, full = DUMP_TRUCK.bed_length_m / 2 - 0.1, DUMP_TRUCK.bed_width_m / 2 - 0.1, 0.75
        elif isinstance(machine, Excavator):
            at, turn = machine.bucket_centre(), yaw_quaternion(machine.yaw + machine.joints["swing"])
            at, (half_x, half_y, full) = (at[0], at[1], at[2] + 0.05), (0.45, 0.42, 0.45)
        else:
            return
        for name in machine.cargo.bodies:
            self._scene.place(bodies[name], at, turn)
        share = machine.cargo.soil_m3 / max(machine.kind.capacity_m3, 1e-9)
        step = math.ceil(min(1.0, share) * LOAD_STEPS - 1e-6)
        body, shown = self._loads.get(machine.id, (-1, 0))
        if shown != step:
            if body >= 0:
                self._scene.remove(body)
            body = -1
            if step > 0:
                key = (-step, 0, 0 if isinstance(machine, DumpTruck) else 1)
                if key not in self._shapes:
                    mesh = self._mounds[key[2]].scaled(half_x, half_y, full * step / LOAD_STEPS)
                    self._shapes[key] = self._scene.mesh_shape(mesh)
                body = self._scene.add(self._shapes[key], self._soil_texture)
            self._loads[machine.id] = (body, step)
        if body >= 0:
            self._scene.place(body, at, turn)

    def _add_ground(self, bounds: Bounds) -> None:
        half_x = (bounds.max_x - bounds.min_x) / 2 + MARGIN_M
        half_y = (bounds.max_y - bounds.min_y) / 2 + MARGIN_M
        texture = self._scene.texture(textures.ground(self._rng))
        ground = self._scene.add(self._scene.mesh_shape(meshes.plane(half_x, half_y)), texture)
        middle = Point(x=(bounds.max_x + bounds.min_x) / 2, y=(bounds.max_y + bounds.min_y) / 2)
        self._scene.place(ground, (middle.x, middle.y, 0.0), FLAT)

    def _stranger(self) -> textures.Picture:
        """Return a colour for a class of thing that nobody described."""
        colour = self._rng.uniform(0.15, 0.9, 3)
        return textures.plain((float(colour[0]), float(colour[1]), float(colour[2])))


def _within(at: Vector, turn: Quaternion, offset: Vector) -> Vector:
    """Return where an offset in a turned frame is."""
    x, y, z, w = turn
    u, v = np.array([x, y, z]), np.array(offset)
    moved = v + 2 * np.cross(u, np.cross(u, v) + w * v) + np.array(at)
    return float(moved[0]), float(moved[1]), float(moved[2])
