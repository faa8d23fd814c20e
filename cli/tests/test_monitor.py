"""`muster monitor`: which keys match, and what is printed of real traffic."""

import json
import subprocess
import sys
from collections.abc import Callable

import pytest
from muster_bus import open_bus
from muster_cli.errors import CliError
from muster_cli.launch import start
from muster_cli.monitor import key_filter, traffic
from muster_cli.processes import Options, Plan
from muster_cli.record import DataDirectory
from muster_schemas.channels import AREAS, KEYWORDS, OBJECT
from muster_schemas.world import AreaRules, Keywords

KEY = "muster/yard/robots/robot_excavator_01/state"


@pytest.mark.parametrize(
    ("expression", "matches"),
    [
        (None, True),
        ("state", True),
        ("muster/*/robots/*/state", True),
        ("robots/*/state", True),
        ("muster/**", True),
        ("**/state", True),
        ("muster/*/state", False),
        ("robots/*", False),
        ("card", False),
    ],
)
def test_which_keys_match(expression: str | None, matches: bool) -> None:
    """`*` stands for one part of a key, `**` for any number, plain text for any key that holds it."""
    assert bool(key_filter(expression).fullmatch(KEY)) is matches


def test_what_no_key_can_have_is_refused() -> None:
    """A pattern with other characters is an error that names what is allowed."""
    with pytest.raises(CliError, match="a-z"):
        key_filter("robots/?")


async def test_traffic_is_seen_as_json(
    plan_with: Callable[..., Plan], options: Options, directory: DataDirectory
) -> None:
    """Messages of every kind come with their key; other keys are left out."""
    plan = plan_with()
    start(plan, options, directory)
    async with open_bus("yard", [plan.endpoint]) as bus:
        bus.publish(AREAS, AreaRules(revision=3))
        async with open_bus("yard", [plan.endpoint]) as other, traffic(other, "areas") as seen:
            assert await seen.get() == ("muster/yard/areas", AreaRules(revision=3).to_json().decode())
            bus.publish(KEYWORDS, Keywords(keywords=("rock",), asked_by="test"))
            bus.publish(AREAS, AreaRules(revision=4))
            assert await seen.get() == ("muster/yard/areas", AreaRules(revision=4).to_json().decode())


def test_plain_lines_are_json(plan_with: Callable[..., Plan], options: Options, directory: DataDirectory) -> None:
    """`muster monitor --plain` prints one JSON object a line, with key and message."""
    plan = plan_with(
        publisher=f"""
import asyncio
from muster_bus import open_bus
from muster_schemas.channels import OBJECT
from muster_schemas.world import MapObject, ObjectSize
from muster_schemas.base import Point
async def main():
    async with open_bus("yard", ["tcp/127.0.0.1:{options.bus_port}"]) as bus:
        thing = MapObject(name="rock1", object_class="rock", position=Point(x=1, y=2),
                          size=ObjectSize(length_m=1, width_m=1), confidence=1, seen_at=1)
        bus.publish(OBJECT, thing, object_name="rock1")
        await asyncio.sleep(3600)
asyncio.run(main())
"""
    )
    start(plan, options, directory)
    command = [sys.executable, "-m", "muster_cli", "monitor", "objects", "--plain"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env={"MUSTER_DATA_DIR": str(directory.root)}
    ) as shown:
        assert shown.stdout is not None
        line = json.loads(shown.stdout.readline())
        shown.terminate()
    assert line["key"] == OBJECT.key(site="yard", object_name="rock1")
    assert line["message"]["position"] == {"x": 1.0, "y": 2.0}
