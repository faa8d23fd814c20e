"""The simulator on the bus: commands come in, telemetry, pictures and the truth go out, site time passes."""

import asyncio
import io
import time
from collections import Counter
from typing import Final

import structlog
from muster_bus import Bus
from muster_schemas.channels import CAMERA_IMAGE, SIM_COMMAND, SIM_TELEMETRY, SIM_WORLD
from PIL import Image

from .camera import pinhole
from .machines.base import CommandError
from .pace import Pace
from .snapshot import SnapshotFile, digest
from .textures import Picture
from .world import STEP_S, World

SHORTEST_BITE_S, LONGEST_BITE_S = 0.005, 0.05
"""Wall time between two looks at the clock; commands and pictures come in between."""
TELEMETRY_STEPS: Final = 3
WORLD_PERIOD_S: Final = 0.5
SNAPSHOT_PERIOD_S: Final = 0.5
JPEG_QUALITY: Final = 90

_log = structlog.stdlib.get_logger(__name__)


class Simulator:
    """Runs a world until told to stop.

    Args:
        bus: connected.
        world: what is simulated.
        factor: site seconds wanted a second.
        snapshots: where the world's state is kept against a crash.

    """

    def __init__(self, bus: Bus, world: World, factor: float, snapshots: SnapshotFile) -> None:
        self._bus = bus
        self._world = world
        self._snapshots = snapshots
        self._pace = Pace(factor, STEP_S, time.monotonic())
        self._refused: Counter[str] = Counter()

    async def run(self, stop: asyncio.Event) -> None:
        """Let site time pass and do what comes over the bus until `stop` is set."""
        if snapshot := self._snapshots.load(digest(self._world.site, self._world.seed)):
            self._world.restore(snapshot)
            _log.warning("resumed", site_time_s=self._world.time_s)
        working = [
            asyncio.create_task(self._obey(), name="obey commands"),
            asyncio.create_task(self._pass_time(), name="pass time"),
            asyncio.create_task(self._film(), name="film"),
            asyncio.create_task(self._tell_truth(), name="tell the truth"),
            asyncio.create_task(self._keep(), name="keep snapshots"),
        ]
        stopping = asyncio.create_task(stop.wait(), name="stop")
        try:
            done, _ = await asyncio.wait((*working, stopping), return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            stopping.cancel()
            for task in working:
                task.cancel()
            await asyncio.gather(*working, return_exceptions=True)
        self._snapshots.remove()

    async def _obey(self) -> None:
        async with self._bus.subscribe(SIM_COMMAND) as commands:
            async for received in commands:
                if received.message is None:
                    continue
                robot_id = received.ids["robot_id"]
                try:
                    self._world.command(robot_id, received.message.root)
                except CommandError as error:
                    self._refused[robot_id] += 1
                    # a sender at 20 Hz would flood the log
                    if self._refused[robot_id] % 1000 == 1:
                        _log.warning("command_refused", robot=robot_id, why=str(error), times=self._refused[robot_id])

    async def _pass_time(self) -> None:
        bite_s = min(max(STEP_S / self._pace.factor, SHORTEST_BITE_S), LONGEST_BITE_S)
        unreported, loads = 0, self._world.load_changes
        while True:
            steps = self._pace.due(time.monotonic(), bite_s)
            for _ in range(steps):
                self._world.step()
            unreported += steps
            if self._world.load_changes != loads:
                # before anyone can hear of it: a load that was reported must not be undone by a crash
                loads = self._world.load_changes
                self._snapshots.save(self._world.snapshot())
            # at most once a bite, since a faster clock would only fill queues that keep the newest
            if unreported >= TELEMETRY_STEPS:
                unreported = 0
                for robot_id in self._world.machines:
                    telemetry = self._world.telemetry(robot_id, self._world.steps)
                    self._bus.publish(SIM_TELEMETRY, telemetry, robot_id=robot_id)
            await asyncio.sleep(bite_s)

    async def _film(self) -> None:
        """Take the cameras' pictures in turn; rendering never takes more than half of the time."""
        cameras, taken = self._world.site.cameras, Counter[str]()
        if not cameras:
            await asyncio.Event().wait()
        start = time.monotonic()
        due = {c.id: start + number / len(cameras) / c.rate_hz for number, c in enumerate(cameras)}
        while True:
            camera = min(cameras, key=lambda c: due[c.id])
            await asyncio.sleep(due[camera.id] - time.monotonic())
            begin = time.monotonic()
            frame = pinhole(camera).frame(camera.id, taken[camera.id], time.time())
            self._bus.publish_bytes(CAMERA_IMAGE, jpeg(self._world.render(camera)), frame, camera_id=camera.id)
            taken[camera.id] += 1
            now = time.monotonic()
            due[camera.id] = max(due[camera.id] + 1 / camera.rate_hz, now)
            await asyncio.sleep(now - begin)

    async def _tell_truth(self) -> None:
        while True:
            self._bus.publish(SIM_WORLD, self._world.truth(self._pace.factor, self._pace.achieved_factor))
            await asyncio.sleep(WORLD_PERIOD_S)

    async def _keep(self) -> None:
        while True:
            self._snapshots.save(self._world.snapshot())
            await asyncio.sleep(SNAPSHOT_PERIOD_S)


def jpeg(picture: Picture) -> bytes:
    """Return a picture (RGB) as it goes over the bus."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=JPEG_QUALITY)
    return buffer.getvalue()
