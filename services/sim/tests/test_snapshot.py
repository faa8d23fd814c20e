"""A simulator that crashed goes on where it was; one that ended begins anew."""

import os
import time
from pathlib import Path

import pytest
from muster_sim.snapshot import FRESH_S, Snapshot, SnapshotFile, digest
from muster_sim.testing import AHEAD_M, Operator, small_site
from muster_sim.world import World

SITE = small_site(
    {"digger": ("excavator", 0.0, 0.0, 0.0), "truck": ("dump_truck", 0.3, AHEAD_M, 0.0)},
    [
        {"name": "soil1", "class": "soil", "position": {"x": 5, "y": 0}, "radius_m": 2.4, "soil_m3": 12},
        {"name": "rock1", "class": "rock", "position": {"x": -5, "y": 0}, "radius_m": 0.8, "height_m": 0.8},
    ],
    [{"id": "down", "position": {"x": 0, "y": 0}, "height_m": 20, "width_px": 160, "height_px": 160}],
)
LEFT = 1.5708


@pytest.fixture
def file(tmp_path: Path) -> SnapshotFile:
    """Return a place for snapshots."""
    return SnapshotFile(tmp_path, SITE)


def in_the_middle_of_work(world: World) -> None:
    """Load the truck with soil, let soil fall, and pick up the rock."""
    operator = Operator(world)
    operator.dig("digger")
    operator.unload("digger", LEFT)
    operator.dig("digger")
    operator.unload("digger", -LEFT)
    operator.dig("digger", swing=3.1)
    operator.drive("truck", 1.0, 0.3)
    operator.wait(2)


def test_a_restored_world_goes_on_exactly() -> None:
    """Truth, totals and pictures are those of the world that was left, and loads can be handled on."""
    with World(SITE) as left, World(SITE) as world:
        in_the_middle_of_work(left)
        world.restore(Snapshot.model_validate_json(left.snapshot().to_json()))
        assert world.truth() == left.truth()
        assert world.truth().robots["digger"].load.bodies == ("rock1",)
        assert world.soil_total_m3() == pytest.approx(left.soil_total_m3())
        assert world.render(SITE.cameras[0]).tobytes() == left.render(SITE.cameras[0]).tobytes()
        operator = Operator(world)
        operator.unload("digger", 3.1)
        assert "rock1" in world.truth().things


def test_restored_machines_wait_for_commands() -> None:
    """Whatever they did before, they stand still."""
    with World(SITE) as left, World(SITE) as world:
        in_the_middle_of_work(left)
        world.restore(left.snapshot())
        before = world.telemetry("truck", 0)
        Operator(world).wait(1)
        assert world.telemetry("truck", 0).pose == before.pose


def test_a_kept_snapshot_is_found_again(file: SnapshotFile) -> None:
    """What was saved is loaded, by the same site and seed only."""
    with World(SITE) as world:
        in_the_middle_of_work(world)
        file.save(world.snapshot())
        assert file.load(digest(SITE, world.seed)) == world.snapshot()
        assert file.load(digest(SITE, world.seed + 1)) is None


def test_a_removed_or_missing_snapshot_is_none(file: SnapshotFile) -> None:
    """A simulator that ended by itself leaves nothing to go on from."""
    with World(SITE) as world:
        wanted = digest(SITE, world.seed)
        assert file.load(wanted) is None
        file.save(world.snapshot())
        file.remove()
        assert file.load(wanted) is None


def test_an_old_or_broken_snapshot_is_left_alone(tmp_path: Path, file: SnapshotFile) -> None:
    """The site begins anew, as its file says."""
    with World(SITE) as world:
        file.save(world.snapshot())
        wanted = digest(SITE, world.seed)
    (path,) = (tmp_path / "sim").iterdir()
    long_ago = time.time() - FRESH_S - 10
    os.utime(path, (long_ago, long_ago))
    assert file.load(wanted) is None
    path.write_bytes(b'{"site": 3')
    assert file.load(wanted) is None


def test_a_place_that_cannot_be_written_does_not_stop_the_site(tmp_path: Path) -> None:
    """The world goes on; a crash would then begin it anew."""
    (tmp_path / "file").write_text("no folder")
    with World(SITE) as world:
        file = SnapshotFile(tmp_path / "file", SITE)
        file.save(world.snapshot())
        assert file.load(digest(SITE, world.seed)) is None
