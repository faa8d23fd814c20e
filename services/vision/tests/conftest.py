"""Cameras over small worlds: by formula where geometry is meant, by the simulator where looks matter."""

import io
import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
import pytest
from muster_bus.testing import SITE_FILE
from muster_schemas.site import Bounds, Camera, Site, load_site
from muster_schemas.world import CameraFrame
from muster_sim.camera import pinhole
from muster_sim.service import jpeg
from muster_sim.world import World
from muster_vision.birdseye import BirdsEye, Grid
from muster_vision.camera import Picture
from muster_vision.clip_model import ClipModel
from PIL import Image

DOWN = (1.0, 0.0, 0.0, 0.0)
"""The quaternion of a camera that looks straight down, north at its top."""

MakeFrame = Callable[..., CameraFrame]
Film = Callable[..., BirdsEye]


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> None:
    """Let OpenCV use one thread, as the service does."""
    cv2.setNumThreads(1)


@pytest.fixture(scope="session")
def yard() -> Site:
    """Provide the default site."""
    return load_site(SITE_FILE)


@pytest.fixture(scope="session")
def model() -> ClipModel:
    """Provide the model that ships with Muster."""
    return ClipModel()


@pytest.fixture
def grid() -> Grid:
    """Provide a grid over 20 m by 10 m."""
    return Grid.over(Bounds(min_x=-10, min_y=-5, max_x=10, max_y=5))


@pytest.fixture
def make_frame() -> MakeFrame:
    """Provide frames of a camera that looks straight down unless told otherwise."""

    def make(
        x: float = 0.0,
        y: float = 0.0,
        z: float = 10.0,
        *,
        side: int = 200,
        angle_deg: float = 60.0,
        orientation: tuple[float, float, float, float] = DOWN,
        camera_id: str = "uav",
        seq: int = 0,
        taken_at: float = 100.0,
    ) -> CameraFrame:
        focal = side / 2 / math.tan(math.radians(angle_deg) / 2)
        return CameraFrame(
            camera_id=camera_id,
            seq=seq,
            taken_at=taken_at,
            width_px=side,
            height_px=side,
            fx_px=focal,
            fy_px=focal,
            cx_px=(side - 1) / 2,
            cy_px=(side - 1) / 2,
            x_m=x,
            y_m=y,
            z_m=z,
            orientation=orientation,
        )

    return make


@pytest.fixture(scope="session")
def film() -> Film:
    """Provide a function that lays the pictures of a world's cameras into a bird's-eye view, a new one or a given."""

    def take(
        world: World, taken_at: float = 100.0, view: BirdsEye | None = None, cameras: Sequence[Camera] | None = None
    ) -> BirdsEye:
        view = view or BirdsEye(Grid.over(world.site.bounds))
        for camera in cameras or world.site.cameras:
            view.add(pinhole(camera).frame(camera.id, 0, taken_at), jpeg(world.render(camera)))
        return view

    return take


def flat_jpeg(colour: tuple[int, int, int], side: int = 200) -> bytes:
    """Return a JPEG of one colour."""
    return as_jpeg(np.full((side, side, 3), colour, np.uint8))


def as_jpeg(picture: Picture) -> bytes:
    """Return the best JPEG of a picture."""
    with io.BytesIO() as file:
        Image.fromarray(picture).save(file, "JPEG", quality=98, subsampling=0)
        return file.getvalue()


@pytest.fixture
def jpeg_of() -> Callable[[Picture], bytes]:
    """Provide `as_jpeg`."""
    return as_jpeg


@pytest.fixture
def one_colour() -> Callable[..., bytes]:
    """Provide `flat_jpeg`."""
    return flat_jpeg
