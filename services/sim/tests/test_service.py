"""The simulator as a process on a real bus."""

import dataclasses
import io
import json
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any, cast

import pytest
from muster_bus import Bus
from muster_bus.testing import Process, RouterProcess, eventually, running_bus, running_router, service_process
from muster_schemas.base import Message
from muster_schemas.channels import CAMERA_IMAGE, SIM_COMMAND, SIM_TELEMETRY, SIM_WORLD, Channel
from muster_schemas.sim import DriveCommand, SimCommand, SimWorld, Telemetry, ToolCommand
from muster_sim.settings import SimSettings
from muster_sim.snapshot import Snapshot
from muster_sim.testing import small_site
from muster_sim.world import STEP_S
from PIL import Image
from pydantic import ValidationError

SITE = small_site(
    {"truck": ("dump_truck", 0, 0, 0), "digger": ("excavator", 0, 8, 0)},
    cameras=[
        {"id": "uav", "position": {"x": 0, "y": 0}, "height_m": 20, "width_px": 96, "height_px": 64, "rate_hz": 5}
    ],
)


class Observer:
    """A bus client that steers and hears the simulator."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._seq = 0

    async def telemetry(self, robot_id: str) -> Telemetry:
        """Return the next one of a robot."""
        async with self._bus.subscribe(SIM_TELEMETRY, robot_id=robot_id) as messages:
            async for received in messages:
                assert received.message is not None
                return received.message
        raise AssertionError("the subscription ended")

    async def world(self) -> SimWorld:
        """Return the next truth."""
        async with self._bus.subscribe(SIM_WORLD) as messages:
            async for received in messages:
                assert received.message is not None
                return received.message
        raise AssertionError("the subscription ended")

    def command(self, robot_id: str, command: DriveCommand | ToolCommand) -> None:
        """Send one command."""
        self._bus.publish(SIM_COMMAND, SimCommand(command), robot_id=robot_id)

    def drive(self, robot_id: str, speed_mps: float) -> None:
        """Send one drive command."""
        self._seq += 1
        self.command(robot_id, DriveCommand(seq=self._seq, speed_mps=speed_mps, turn_radps=0.0))


@pytest.fixture(scope="module")
def router() -> Iterator[RouterProcess]:
    """Provide one router for all of these tests, since none harms it."""
    with running_router() as process:
        yield process


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Return the settings of a simulator of the small site, four times as fast as the clock."""
    path = tmp_path / "small.yaml"
    # JSON is YAML
    path.write_text(SITE.model_dump_json(by_alias=True), encoding="utf-8")
    return {"MUSTER_SITE_FILE": str(path), "MUSTER_SPEED_FACTOR": "4", "MUSTER_DATA_DIR": str(tmp_path / "data")}


@pytest.fixture
async def sim(router: RouterProcess, environment: dict[str, str]) -> AsyncIterator[Process]:
    """Provide a running simulator."""
    async with service_process("muster_sim", router, environment) as process:
        yield process


@pytest.fixture
async def observer(router: RouterProcess, sim: Process) -> AsyncIterator[Observer]:
    """Provide a client of the running simulator that already hears it."""
    async with running_bus(router, SITE.name) as bus:
        observer = Observer(bus)
        await observer.telemetry("truck")
        yield observer


async def test_telemetry_comes_and_site_time_passes(observer: Observer) -> None:
    """Every robot tells its pose; sequence numbers and site time grow."""
    first, digger = await observer.telemetry("truck"), await observer.telemetry("digger")
    later = await observer.telemetry("truck")
    assert (digger.robot_id, digger.pose) == ("digger", SITE.robots[1].home)
    assert later.seq > first.seq
    assert later.site_time_s > first.site_time_s


async def test_commands_move_a_robot_which_halts_when_they_cease(observer: Observer) -> None:
    """It drives while it is told to, and stands when nobody tells it anything."""

    async def has_moved() -> bool:
        observer.drive("truck", 2.0)
        return (await observer.telemetry("truck")).pose.x > 1.0

    await eventually(has_moved)
    await eventually(lambda: is_halted(observer))
    halted = (await observer.telemetry("truck")).pose
    assert halted.x > 1.0
    assert (await observer.telemetry("truck")).pose == halted


async def is_halted(observer: Observer) -> bool:
    """Return whether the truck stands."""
    return (await observer.telemetry("truck")).speed_mps == 0


async def test_a_tool_command_moves_a_joint(observer: Observer) -> None:
    """The bed tips."""

    async def tipped() -> bool:
        observer.command("truck", ToolCommand(seq=0, joints={"bed": 1.0}))
        return (await observer.telemetry("truck")).joints["bed"] == pytest.approx(1.0)

    await eventually(tipped)


class Nonsense(Message):
    """What a broken sender might send."""

    kind: str = "drive"
    seq: int = 1
    speed_mps: float | str = "fast"
    turn_radps: float = 0.0


async def test_commands_that_make_no_sense_change_nothing(
    router: RouterProcess, sim: Process, observer: Observer
) -> None:
    """Wrong fields, unknown joints and unknown robots are refused, and the simulator goes on."""
    channel: Channel[Any] = dataclasses.replace(cast("Channel[Any]", SIM_COMMAND), model=Nonsense)
    async with running_bus(router, SITE.name) as bus:
        bus.publish(channel, Nonsense(), robot_id="truck")
        bus.publish(channel, Nonsense(kind="fly", speed_mps=1.0), robot_id="truck")
        bus.publish(channel, Nonsense(speed_mps=1e9), robot_id="truck")
        observer.command("truck", ToolCommand(seq=0, joints={"bed": 1.0, "wings": 1.0}))
        observer.command("nobody", DriveCommand(seq=0, speed_mps=1.0, turn_radps=0.0))
        await eventually(lambda: {line["robot"] for line in sim.logged("command_refused")} == {"truck", "nobody"})
        telemetry = await observer.telemetry("truck")
    assert telemetry.pose == SITE.robots[0].home
    assert telemetry.joints == {"bed": 0.0}


async def test_the_truth_tells_the_time_and_the_factor(observer: Observer) -> None:
    """Two looks at it agree with the speed that was asked for and that it says it reached."""
    truth = await observer.world()
    assert truth.speed_factor == 4
    assert set(truth.robots) == {"truck", "digger"}
    await eventually(lambda: has_passed(observer, truth.site_time_s + 4))
    assert (await observer.world()).achieved_factor > 0


async def has_passed(observer: Observer, site_time_s: float) -> bool:
    """Return whether it is later than that on the site."""
    return (await observer.world()).site_time_s > site_time_s


async def test_pictures_come_with_their_pose(router: RouterProcess, sim: Process) -> None:
    """A JPEG of the camera's size, with where it was taken from."""
    async with running_bus(router, SITE.name) as bus, bus.subscribe(CAMERA_IMAGE) as pictures:
        async for received in pictures:
            frame = received.message
            assert frame is not None
            assert received.ids == {"camera_id": "uav"}
            assert (frame.x_m, frame.y_m, frame.z_m) == (0, 0, 20)
            picture = Image.open(io.BytesIO(received.payload))
            assert (picture.format, picture.size) == ("JPEG", (96, 64))
            if frame.seq >= 2:
                return


def snapshots(environment: dict[str, str]) -> list[Snapshot]:
    """Return what the simulator has kept."""
    folder = Path(environment["MUSTER_DATA_DIR"]) / "sim"
    return [Snapshot.model_validate_json(path.read_bytes()) for path in folder.glob("*.json")]


async def test_it_ends_cleanly_when_asked(sim: Process, environment: dict[str, str]) -> None:
    """SIGTERM ends it with exit code 0, and nothing is left to go on from."""
    await eventually(lambda: snapshots(environment))
    assert await sim.terminate() == 0
    assert snapshots(environment) == []


async def test_a_killed_simulator_goes_on_where_it_was(
    router: RouterProcess, sim: Process, observer: Observer, environment: dict[str, str]
) -> None:
    """The bed that was tipped before a kill -9 is tipped after it, and site time goes on."""

    async def tipped() -> bool:
        observer.command("truck", ToolCommand(seq=0, joints={"bed": 1.0}))
        kept = snapshots(environment)
        return bool(kept) and kept[0].machines["truck"].joints["bed"] == pytest.approx(1.0)

    await eventually(tipped)
    kept_s = snapshots(environment)[0].steps * STEP_S
    await sim.kill()
    async with service_process("muster_sim", router, environment) as process:
        await process.until_logged("resumed")
        after = await observer.telemetry("truck")
    assert after.joints["bed"] == pytest.approx(1.0)
    assert after.site_time_s >= kept_s


@pytest.mark.parametrize("factor", ["0", "-1", "fast", "inf", "nan"])
def test_a_speed_factor_that_makes_no_sense_is_refused(monkeypatch: pytest.MonkeyPatch, factor: str) -> None:
    """The error names the setting."""
    monkeypatch.setenv("MUSTER_SPEED_FACTOR", factor)
    with pytest.raises(ValidationError, match="speed_factor"):
        SimSettings()


async def test_a_site_file_that_cannot_be_read_is_refused(router: RouterProcess, tmp_path: Path) -> None:
    """It does not start, and says where the mistake is."""
    path = tmp_path / "bad.yaml"
    path.write_text(json.dumps({"name": "BAD NAME", "robots": []}), encoding="utf-8")
    async with service_process("muster_sim", router, {"MUSTER_SITE_FILE": str(path)}, wait=False) as process:
        assert await process.ended() == 78
        assert "bounds" in process.output
