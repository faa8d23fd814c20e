"""Any Zenoh program can read along: a plain session without Muster's code sees missions, requests, robots, objects."""

# pyright: reportUnknownMemberType=false
# (Zenoh's stubs leave return types out.)

import asyncio
import json
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zenoh
from muster_bus import open_bus
from muster_bus.testing import eventually

from tests.running_site import RunningSite, describe, plan_of_case, running_site, submit, succeeded, until_ended

CASE = "B-L1-021"
TRUCK = "robot_dump_truck_01"
Json = dict[str, Any]

pytestmark = [pytest.mark.end_to_end, pytest.mark.timeout(2400)]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSite]:
    """Run the default site."""
    with running_site(tmp_path_factory.mktemp("site"), speed=4) as running:
        yield running


@pytest.fixture
def stranger(site: RunningSite) -> Iterator[zenoh.Session]:
    """Provide a session as any Zenoh tool would open it."""
    config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [site.endpoint]}}))
    with zenoh.open(config) as session:
        yield session


async def test_a_mission_is_seen_by_key_as_json(site: RunningSite, stranger: zenoh.Session) -> None:
    """Mission, tasks, requests, statuses and robot states come on their keys, each a JSON object."""
    seen: dict[str, list[Json]] = defaultdict(list)

    def note(sample: zenoh.Sample) -> None:
        if sample.encoding == zenoh.Encoding.APPLICATION_JSON and sample.kind == zenoh.SampleKind.PUT:
            seen[str(sample.key_expr)].append(json.loads(sample.payload.to_bytes()))

    with stranger.declare_subscriber("muster/yard/**", note):
        async with open_bus("yard", [site.endpoint]) as bus:
            mission_id = await submit(bus, "tip at the soil", plan_of_case(CASE))
            view = await until_ended(bus, mission_id, 900)
        assert succeeded(view), describe(view)
        root = f"muster/yard/missions/{mission_id}"
        await eventually(lambda: seen[f"{root}/state"] and seen[f"{root}/state"][-1]["state"] == "succeeded")
    assert seen[f"{root}/state"][0]["text"] == "tip at the soil"
    await eventually(lambda: seen[f"{root}/tasks/t2/state"][-1]["state"] == "succeeded")
    # An empty bed is tipped in a moment: the states between may be one step of the scheduler, and so one message
    assert {t["state"] for t in seen[f"{root}/tasks/t2/state"]} >= {"waiting", "succeeded"}
    assert any("dependency: t1" in t["waiting_for"] for t in seen[f"{root}/tasks/t2/state"])
    skills = f"muster/yard/robots/{TRUCK}/skills/dump_unloading"
    assert seen[f"{skills}/request"][0]["action"] == "start"
    assert [s["state"] for s in seen[f"{skills}/status"]][-1] == "succeeded"
    assert seen[f"{skills}/ack"]
    assert len(seen[f"muster/yard/robots/{TRUCK}/state"]) > 3


@pytest.mark.parametrize(
    ("selector", "names"),
    [
        ("muster/yard/objects/*", {"soil1", "soil2", "puddle1", "puddle2", "obstacle1", "obstacle2", "rock1"}),
        ("muster/yard/robots/*/card", {f"robot_{k}_{n:02d}" for k in ("excavator", "dump_truck") for n in (1, 2, 3)}),
    ],
)
async def test_what_is_known_can_be_asked_for_at_any_time(
    stranger: zenoh.Session, selector: str, names: set[str]
) -> None:
    """A plain get returns the last value of each key, also to one who comes late."""
    part = selector.split("/").index("*")

    def ask() -> dict[str, Json]:
        replies = [r.ok for r in stranger.get(selector, timeout=60.0)]
        return {str(r.key_expr).split("/")[part]: json.loads(r.payload.to_bytes()) for r in replies if r is not None}

    found: Callable[[], Any] = ask
    values = await asyncio.to_thread(found)
    assert set(values) >= names
    assert all(isinstance(value, dict) for value in values.values())


async def test_camera_images_are_jpegs(site: RunningSite, stranger: zenoh.Session) -> None:
    """The one binary channel: a JPEG, with its metadata as JSON in the attachment."""
    frames: list[tuple[bytes, Json]] = []

    def note(sample: zenoh.Sample) -> None:
        if sample.attachment is not None:
            frames.append((sample.payload.to_bytes(), json.loads(sample.attachment.to_bytes())))

    with stranger.declare_subscriber("muster/yard/cameras/*/image", note):
        await eventually(lambda: len(frames) >= 2, within_s=300)
    image, meta = frames[0]
    assert image[:2] == b"\xff\xd8"
    assert meta["camera_id"].startswith("uav_")
    assert meta["width_px"] > 0
