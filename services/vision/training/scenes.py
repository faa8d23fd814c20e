"""Random sites, rendered by the simulator, and where everything in them is."""

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from muster_schemas.machines import EXCAVATOR
from muster_schemas.site import Site
from muster_sim.camera import pinhole
from muster_sim.machines.base import Machine
from muster_sim.machines.excavator import Excavator
from muster_sim.world import World
from muster_vision.birdseye import BirdsEye, Grid
from muster_vision.camera import Floats, View
from PIL import Image

CLASSES: Final = ("puddle", "soil", "obstacle", "rock", "excavator", "dump_truck", "carrier", "crate", "mat")
"""What scenes hold: the default site's classes, a robot of another make, and two kinds of unknown things."""
GROUND: Final = "ground"
PART: Final = "part"

ROBOT_TYPES: Final[dict[str, dict[str, Any]]] = {
    "excavator": {
        "body": "excavator", "length_m": 3.6, "width_m": 2.5, "max_speed_mps": 1.5, "reach_m": 7.5, "capacity_m3": 0.5,
    },
    "dump_truck": {
        "body": "dump_truck", "length_m": 3.6, "width_m": 2.2, "max_speed_mps": 2.5, "capacity_m3": 1.5,
    },
    "carrier": {"body": "carrier", "length_m": 2.0, "width_m": 1.4, "max_speed_mps": 2.0},
}  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """One thing or machine and the ground rectangle (west, south, east, north) in which the cameras show it."""

    label: str
    box: tuple[float, float, float, float]
    machine: bool
    x: float = 0.0
    y: float = 0.0
    area_m2: float = 0.0


@dataclass(frozen=True)
class Scene:
    """A rendered bird's-eye view and what is in it."""

    view: BirdsEye
    truths: tuple[Truth, ...]


def scenes(first: int, count: int) -> Iterator[Scene]:
    """Yield the scenes of seeds `first` to `first + count - 1`; a seed always gives the same scene."""
    for seed in range(first, first + count):
        rng = np.random.default_rng([seed, 42])
        site = random_site(rng)
        with World(site, seed=seed) as world:
            for machine in world.machines.values():
                _pose(machine, rng)
            yield render(world)


def render(world: World) -> Scene:
    """Return what the cameras of a world show."""
    view = BirdsEye(Grid.over(world.site.bounds))
    for camera in world.site.cameras:
        frame = pinhole(camera).frame(camera.id, 0, 1.0)
        with io.BytesIO() as file:
            Image.fromarray(world.render(camera)).save(file, "JPEG", quality=85)
            view.add(frame, file.getvalue())
    return Scene(view, tuple(_truths(world, view)))


def random_site(rng: np.random.Generator) -> Site:
    """Return a site with random things, machines and cameras."""
    width, height = rng.uniform(34, 52), rng.uniform(28, 40)
    taken: list[tuple[float, float, float]] = []
    things = [_thing(i, c, rng, taken, width, height) for i, c in enumerate(_kinds(rng))]
    for i, puddle in enumerate([t for t in things if t["class"] == "puddle"]):
        if rng.random() < 0.35:
            things.append(_tipped_onto(puddle, f"tipped{i}", rng))
    robots: list[dict[str, Any]] = []
    for i, kind in enumerate(["excavator"] * 3 + ["dump_truck"] * 3 + ["carrier"]):
        x, y = _spot(rng, taken, 2.3, width, height)
        yaw = float(rng.uniform(-math.pi, math.pi))
        robots.append({"id": f"r{i}", "type": kind, "home": {"x": x, "y": y, "yaw": yaw}})
    return Site.model_validate(
        {
            "name": "scene",
            "bounds": {"min_x": -width / 2, "min_y": -height / 2, "max_x": width / 2, "max_y": height / 2},
            "robot_types": ROBOT_TYPES,
            "robots": robots,
            "things": things,
            "cameras": list(_cameras(rng, width, height)),
        }
    )


def _kinds(rng: np.random.Generator) -> list[str]:
    wanted = {"puddle": 3, "soil": 3, "obstacle": 3, "rock": 3, "crate": 2, "mat": 1}
    return [name for name, most in wanted.items() for _ in range(int(rng.integers(1, most + 1)))]


def _thing(
    number: int,
    kind: str,
    rng: np.random.Generator,
    taken: list[tuple[float, float, float]],
    width: float,
    height: float,
) -> dict[str, Any]:
    low, high, tall = {
        "puddle": (1.0, 3.0, 0.0),
        "soil": (0.7, 2.9, 0.62),
        "obstacle": (0.6, 1.3, 1.0),
        "rock": (0.55, 1.3, 1.0),
        "crate": (0.7, 1.6, 0.8),
        "mat": (0.7, 2.0, 0.0),
    }[kind]
    radius = float(rng.uniform(low, high))
    x, y = _spot(rng, taken, radius, width, height)
    return {
        "name": f"{kind}{number}",
        "class": kind,
        "position": {"x": x, "y": y},
        "radius_m": radius,
        "height_m": radius * tall * float(rng.uniform(0.8, 1.2)),
    }


def _tipped_onto(puddle: dict[str, Any], name: str, rng: np.random.Generator) -> dict[str, Any]:
    away = rng.uniform(0, 0.8) * puddle["radius_m"]
    turn = rng.uniform(0, 2 * math.pi)
    radius = float(rng.uniform(0.75, 1.2))
    at = {"x": puddle["position"]["x"] + away * math.cos(turn), "y": puddle["position"]["y"] + away * math.sin(turn)}
    return {"name": name, "class": "soil", "position": at, "radius_m": radius, "height_m": 0.6 * radius}


def _spot(
    rng: np.random.Generator, taken: list[tuple[float, float, float]], radius: float, width: float, height: float
) -> tuple[float, float]:
    x = y = 0.0
    for _ in range(200):
        x = float(rng.uniform(-width / 2 + radius, width / 2 - radius))
        y = float(rng.uniform(-height / 2 + radius, height / 2 - radius))
        if all(math.hypot(x - a, y - b) > radius + r + 0.4 for a, b, r in taken):
            break
    taken.append((x, y, radius))
    return x, y


def _cameras(rng: np.random.Generator, width: float, height: float) -> Iterator[dict[str, Any]]:
    """Yield two to four cameras side by side; some are tilted."""
    columns, rows = int(rng.integers(1, 3)), int(rng.integers(1, 3))
    columns += (columns, rows) == (1, 1)
    angle = float(rng.uniform(50, 75))
    across = max(width / columns, height / rows)
    high = across / 2 / math.tan(math.radians(angle) / 2) * float(rng.uniform(1.0, 1.35))
    pixels = int(rng.choice([256, 320, 320, 480]))
    for column in range(columns):
        for row in range(rows):
            x, y = (column + 0.5) / columns * width - width / 2, (row + 0.5) / rows * height - height / 2
            camera = {
                "id": f"c{column}{row}", "position": {"x": x, "y": y}, "height_m": high, "field_of_view_deg": angle,
                "width_px": pixels, "height_px": pixels,
            }  # fmt: skip
            if rng.random() < 0.25:
                camera["look_at"] = {"x": x * float(rng.uniform(0.6, 1)), "y": y + float(rng.uniform(-5, 5))}
            yield camera


def _pose(machine: Machine, rng: np.random.Generator) -> None:
    """Put a machine's joints and load anyhow; half of the machines stay at rest."""
    if rng.random() < 0.35:
        return
    for name, limit in machine.joint_limits.items():
        machine.joints[name] = float(rng.uniform(limit.low, limit.high))
    if isinstance(machine, Excavator):
        # the bucket may not be under the ground
        while machine.tip()[2] < -0.2:
            machine.joints["boom"] += 0.1
    if rng.random() < 0.5:
        machine.cargo.soil_m3 = float(rng.uniform(0, machine.kind.capacity_m3))


def _truths(world: World, view: BirdsEye) -> Iterator[Truth]:
    for thing in world.site.things:
        radius = thing.radius_m * {"obstacle": 0.85, "rock": 0.88, "crate": 0.9}.get(thing.object_class, 0.97)
        turns = np.linspace(0, 2 * math.pi, 16, endpoint=False)
        circle = radius * np.column_stack([np.cos(turns), np.sin(turns)]) + [thing.position.x, thing.position.y]
        points = np.column_stack([circle, np.zeros(16)])
        # a heap's top lies over its base; others are as broad above as below
        if thing.object_class not in ("soil", "puddle", "mat"):
            points = np.vstack([points, np.column_stack([circle, np.full(16, thing.height_m * 0.9)])])
        box = seen_box(points, view)
        if box is not None:
            at = thing.position
            yield Truth(thing.object_class, box, machine=False, x=at.x, y=at.y, area_m2=math.pi * thing.radius_m**2)
    for machine in world.machines.values():
        for points in _outlines(machine):
            box = seen_box(points, view)
            if box is not None:
                yield Truth(machine.kind.body, box, machine=True, x=machine.x, y=machine.y)


def _outlines(machine: Machine) -> Iterator[Floats]:
    """Yield the points of a machine: all of it, and for one with an arm also without that."""
    half_x, half_y = machine.kind.length_m / 2, machine.kind.width_m / 2
    signs = [(a, b) for a in (-1, 1) for b in (-1, 1)]
    tracks = [(*machine.place(a * half_x, b * half_y), z) for a, b in signs for z in (0.0, 0.8)]
    if not isinstance(machine, Excavator):
        top = 0.7 if machine.kind.body == "carrier" else 2.0
        bed = math.sin(machine.joints.get("bed", 0.0)) * 2.4
        body = [(*machine.place(a * half_x, b * half_y), top) for a, b in signs]
        body += [(*machine.place(0.0, b * 0.9), 1.0 + bed) for b in (-1, 1)] if bed > 0 else []
        yield np.array(tracks + body)
        return
    swing, joints = machine.joints["swing"], machine.joints
    house = [(*machine.place(x, y, swing), z) for x in (-1.9, 1.0) for y in (-1.15, 1.15) for z in (1.0, 2.2)]
    yield np.array(tracks + house)
    foot = (EXCAVATOR.boom_foot_x_m, EXCAVATOR.boom_foot_z_m)
    knee = (foot[0] + 3.9 * math.cos(joints["boom"]), foot[1] + 3.9 * math.sin(joints["boom"]))
    bucket = EXCAVATOR.bucket_joint(joints["boom"], joints["arm"])
    tip = EXCAVATOR.bucket_tip(joints["boom"], joints["arm"], joints["bucket"])
    arm = [(*machine.place(x, y, swing), max(z, 0.0)) for x, z in (knee, bucket, tip) for y in (-0.45, 0.45)]
    yield np.array(tracks + house + arm)


def seen_box(points: Floats, view: BirdsEye) -> tuple[float, float, float, float] | None:
    """Return the ground rectangle in which the best camera shows points (N, 3); None if that is off the grid."""
    middle = points.mean(axis=0)[:2]
    column, row = (round(c) for c in view.grid.to_cells(middle[None, :])[0].tolist())
    if not (0 <= column < view.grid.columns and 0 <= row < view.grid.rows):
        return None
    best = max(view.layers.values(), key=lambda layer: float(layer.preference[row, column]))
    ground = _cast(points, best.view)
    west, south = ground.min(axis=0)
    east, north = ground.max(axis=0)
    return float(west), float(south), float(east), float(north)


def _cast(points: Floats, view: View) -> Floats:
    """Return where on the ground a camera shows points (N, 3)."""
    return (
        view.centre[:2]
        + (points[:, :2] - view.centre[:2]) * (view.centre[2] / (view.centre[2] - points[:, 2]))[:, None]
    )
