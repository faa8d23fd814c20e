"""The service as a process on a real bus, fed by the real simulator or by the test."""

import asyncio
import json
import threading
import time
from collections.abc import AsyncGenerator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from muster_bus import Bus
from muster_bus.testing import SITE_FILE, Process, RouterProcess, eventually, running_bus, service_process
from muster_schemas.base import Point
from muster_schemas.channels import CAMERA_IMAGE, KEYWORDS, OBJECT
from muster_schemas.site import Site
from muster_schemas.world import CameraFrame, Keywords, MapObject
from muster_sim.camera import pinhole
from muster_sim.service import jpeg
from muster_sim.world import World
from muster_vision.clip_model import ClipModel
from muster_vision.pipeline import Pipeline
from muster_vision.robots import RobotWatch
from muster_vision.service import Vision
from muster_vision.store import MapFile
from muster_vision.vocabulary import Wishes

YARD = {"puddle1", "puddle2", "obstacle1", "obstacle2", "rock1", "soil1", "soil2"}
WITHIN_S = 400.0
"""Generous: loading the model's libraries alone takes ten seconds of processor time, on cores that others use too."""

pytestmark = pytest.mark.timeout(1800)


class Map:
    """What a reader of the object map knows."""

    def __init__(self) -> None:
        self.objects: dict[str, MapObject] = {}
        self.retracted: list[str] = []

    async def follow(self, bus: Bus) -> None:
        """Read until cancelled."""
        async with bus.subscribe(OBJECT) as objects:
            async for received in objects:
                name = received.ids["object_name"]
                if received.message is None:
                    self.objects.pop(name, None)
                    self.retracted.append(name)
                else:
                    self.objects[name] = received.message


@asynccontextmanager
async def reading(bus: Bus) -> AsyncGenerator[Map]:
    """Follow the object map while entered."""
    found = Map()
    task = asyncio.create_task(found.follow(bus))
    try:
        yield found
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


class Uav:
    """The cameras of a site that stands still, flown by the test."""

    def __init__(self, bus: Bus, site: Site) -> None:
        self._bus = bus
        self._site = site
        self._seq = 0
        self._pictures: dict[str, bytes] = {}
        self.show(site)

    def show(self, site: Site) -> None:
        """Film this from now on."""
        with World(site) as world:
            self._pictures = {c.id: jpeg(world.render(c)) for c in self._site.cameras}

    def send(self) -> None:
        """Send a frame of each camera."""
        self._seq += 1
        for camera in self._site.cameras:
            frame = pinhole(camera).frame(camera.id, self._seq, time.time())
            self._bus.publish_bytes(CAMERA_IMAGE, self._pictures[camera.id], frame, camera_id=camera.id)

    async def until(self, condition: Callable[[], bool], within_s: float = WITHIN_S) -> None:
        """Send frames, some each second, until something is so."""

        async def sent_and_so() -> bool:
            self.send()
            await asyncio.sleep(0.3)
            return condition()

        await eventually(sent_and_so, within_s)


def yard_with(change: Callable[[dict[str, Any]], None]) -> Site:
    """Return the default site, changed."""
    data: dict[str, Any] = yaml.safe_load(SITE_FILE.read_text(encoding="utf-8"))
    change(data)
    return Site.model_validate(data)


def without(*names: str) -> Site:
    """Return the default site without some of its things."""

    def leave_out(data: dict[str, Any]) -> None:
        data["things"] = [t for t in data["things"] if t["name"] not in names]

    return yard_with(leave_out)


@pytest.fixture
def environment(tmp_path: Path) -> Mapping[str, str]:
    """Provide a data directory of the test's own."""
    return {"MUSTER_DATA_DIR": str(tmp_path)}


async def test_the_object_map_of_the_simulated_yard_appears_on_the_bus(
    router: RouterProcess, environment: Mapping[str, str], yard: Site
) -> None:
    """All seven things under the names of the site's file, where they are, in JSON; and the service ends with 0."""
    async with (
        service_process("muster_vision", router, environment) as vision,
        service_process("muster_sim", router, environment),
        running_bus(router) as bus,
        reading(bus) as seen,
    ):
        await eventually(lambda: set(seen.objects) == YARD, WITHIN_S)
        for thing in yard.things:
            found = seen.objects[thing.name]
            assert found.object_class == thing.object_class
            assert found.position.distance(thing.position) < 0.25
        told = json.loads(seen.objects["puddle2"].to_json())
        assert told["class"] == "puddle"
        assert len(told["shape"]) >= 8
        assert told["size"]["length_m"] == pytest.approx(4.3, abs=0.4)
        first = {name: found.seen_at for name, found in seen.objects.items()}
        await eventually(lambda: all(seen.objects[n].seen_at > at for n, at in first.items()), WITHIN_S)
        assert await vision.terminate() == 0


async def test_what_was_taken_away_is_retracted_and_is_itself_again_where_it_is_put_down(
    router: RouterProcess, environment: Mapping[str, str], yard: Site
) -> None:
    """An obstacle goes, and comes back elsewhere under its name; the others stay."""

    def moved(data: dict[str, Any]) -> None:
        (obstacle,) = [t for t in data["things"] if t["name"] == "obstacle1"]
        obstacle["position"] = {"x": 2.0, "y": -15.0}

    async with (
        service_process("muster_vision", router, environment),
        running_bus(router) as bus,
        reading(bus) as seen,
    ):
        uav = Uav(bus, yard)
        await uav.until(lambda: set(seen.objects) == YARD)
        uav.show(without("obstacle1"))
        await uav.until(lambda: "obstacle1" not in seen.objects)
        assert seen.retracted == ["obstacle1"]
        uav.show(yard_with(moved))
        await uav.until(lambda: set(seen.objects) == YARD)
        assert seen.objects["obstacle1"].position.x == pytest.approx(2.0, abs=0.25)


async def test_names_survive_a_restart(router: RouterProcess, environment: Mapping[str, str], yard: Site) -> None:
    """Killed at work; the next life knows puddle2 although puddle1 is gone, and gives new things new numbers."""
    async with running_bus(router) as bus:
        async with service_process("muster_vision", router, environment) as vision, reading(bus) as seen:
            await Uav(bus, yard).until(lambda: set(seen.objects) == YARD)
            await vision.kill()
        async with service_process("muster_vision", router, environment), reading(bus) as seen:
            await eventually(lambda: set(seen.objects) == YARD, WITHIN_S)
            uav = Uav(bus, without("puddle1"))
            await uav.until(lambda: "puddle1" not in seen.objects)
            assert set(seen.objects) == YARD - {"puddle1"}


async def test_a_keyword_is_looked_for_when_someone_wants_it(
    router: RouterProcess, environment: Mapping[str, str], tmp_path: Path
) -> None:
    """To a site that does not name rocks a rock is nothing, until someone asks for one."""

    def forget_rocks(data: dict[str, Any]) -> None:
        del data["vision"]["classes"]["rock"]

    site = yard_with(forget_rocks)
    file = tmp_path / "site.json"
    file.write_text(site.model_dump_json(by_alias=True), encoding="utf-8")
    async with (
        service_process("muster_vision", router, {**environment, "MUSTER_SITE_FILE": str(file)}) as vision,
        running_bus(router) as bus,
        reading(bus) as seen,
    ):
        uav = Uav(bus, site)
        await uav.until(lambda: set(seen.objects) == YARD - {"rock1"})
        bus.publish(KEYWORDS, Keywords(keywords=("rock7",), asked_by="planner", for_s=600))
        await vision.until_logged("keywords")
        await uav.until(lambda: "rock1" in seen.objects)
        assert set(seen.objects) == YARD
        assert seen.objects["rock1"].position.distance(Point(x=7, y=-2)) < 0.25


async def test_malformed_frames_are_dropped_and_the_map_goes_on(
    router: RouterProcess, environment: Mapping[str, str], yard: Site
) -> None:
    """Truncated, of another size, absurdly large, from the future, no picture at all."""

    def drops(vision: Process) -> int:
        return len(vision.logged("frame_dropped"))

    async with (
        service_process("muster_vision", router, environment) as vision,
        running_bus(router) as bus,
        reading(bus) as seen,
    ):
        uav = Uav(bus, yard)
        await uav.until(lambda: set(seen.objects) == YARD)
        camera = yard.cameras[0]
        good = jpeg_of(yard)
        frame = pinhole(camera).frame(camera.id, 10_000, time.time())
        bad: tuple[tuple[bytes, CameraFrame], ...] = (
            (good[: len(good) // 2], frame),
            (b"no picture", frame),
            (good, frame.model_copy(update={"width_px": 100})),
            (good, frame.model_copy(update={"width_px": 8000, "height_px": 8000})),
            (good, frame.model_copy(update={"orientation": (9.0, 0.0, 0.0, 0.0)})),
            (good, frame.model_copy(update={"taken_at": time.time() + 86_400})),
        )
        for number, (payload, meta) in enumerate(bad, start=1):
            bus.publish_bytes(CAMERA_IMAGE, payload, meta, camera_id=camera.id)
            await eventually(lambda number=number: drops(vision) == number, WITHIN_S)
        before = max(o.seen_at for o in seen.objects.values())
        await uav.until(lambda: min(o.seen_at for o in seen.objects.values()) > before)
        assert set(seen.objects) == YARD


@pytest.mark.parametrize(("owner", "method"), [(RobotWatch, "stands"), (Wishes, "vocabulary")])
async def test_what_messages_change_is_read_where_they_come_in(
    owner: type[object],
    method: str,
    *,
    router: RouterProcess,
    yard: Site,
    model: ClipModel,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A look works in a thread of its own on what it was given: no message may change it under its hands."""
    readers: set[int] = set()
    read: Callable[..., Any] = getattr(owner, method)

    def noted(*arguments: Any) -> Any:
        readers.add(threading.get_ident())
        return read(*arguments)

    monkeypatch.setattr(owner, method, noted)
    file = MapFile(tmp_path, yard.name)
    stop = asyncio.Event()
    async with running_bus(router) as bus:
        running = asyncio.create_task(Vision(bus, yard, Pipeline(yard, model, file.load()), file).run(stop))
        await eventually(lambda: readers, WITHIN_S)
        stop.set()
        await running
    assert readers == {threading.get_ident()}


def jpeg_of(site: Site) -> bytes:
    """Return what the site's first camera sees."""
    with World(site) as world:
        return jpeg(world.render(site.cameras[0]))


async def test_a_model_that_cannot_be_loaded_is_said_and_ends_the_service(
    router: RouterProcess, environment: Mapping[str, str]
) -> None:
    """With the names of the settings to change."""
    wrong = {**environment, "MUSTER_VISION_MODEL": "ViT-B-32", "MUSTER_VISION_PRETRAINED": "/nowhere/weights.bin"}
    async with service_process("muster_vision", router, wrong, wait=False) as vision:
        assert await vision.ended(WITHIN_S) == 78
        assert "MUSTER_VISION_PRETRAINED" in vision.output
