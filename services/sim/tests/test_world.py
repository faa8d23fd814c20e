"""Machines obey commands within their limits, halt without them, and never pass through anything."""

import math
from pathlib import Path

import pytest
from muster_schemas.base import Point
from muster_schemas.sim import DriveCommand, ToolCommand
from muster_schemas.site import Camera, SiteError, load_site
from muster_sim.machines.base import CommandError
from muster_sim.testing import Operator, small_site
from muster_sim.world import STEP_S, World

YARD = Path(__file__).parents[3] / "sites" / "yard.yaml"
TRUCK = {"truck": ("dump_truck", 0.0, 0.0, 0.0)}
WALL = {"name": "obstacle1", "class": "obstacle", "position": {"x": 6, "y": 0}, "radius_m": 1.0, "height_m": 1.0}


def test_the_default_site_is_built_as_its_file_says() -> None:
    """Robots stand at home, things and soil lie where they should."""
    site = load_site(YARD)
    with World(site) as world:
        truth = world.truth()
    assert {r.id: r.home for r in site.robots} == {r: b.pose for r, b in truth.robots.items()}
    assert set(truth.things) | {s.pile for s in truth.soil} == {t.name for t in site.things}
    assert [s.soil_m3 for s in truth.soil] == [12, 12]
    assert truth.robot_contacts == 0


def test_a_robot_drives_to_a_place() -> None:
    """Turning and driving lead where an operator steers to."""
    with World(small_site(TRUCK)) as world:
        operator = Operator(world)
        operator.drive_to("truck", -8, 6)
        pose = world.telemetry("truck", 0).pose
    assert math.hypot(pose.x + 8, pose.y - 6) < 0.5


def test_speed_grows_within_the_limits() -> None:
    """It takes time to reach the speed, and more than the machine can is cut."""
    with World(small_site(TRUCK)) as world:
        operator = Operator(world)
        operator.drive("truck", 20.0, 10.0)
        operator.wait(0.5)
        assert world.telemetry("truck", 0).speed_mps == pytest.approx(0.75)
        operator.wait(3)
        assert world.telemetry("truck", 0).speed_mps == pytest.approx(2.5)
        assert world.telemetry("truck", 0).turn_radps == pytest.approx(0.6)


def test_driving_and_turning_together_follow_a_circle() -> None:
    """Its radius is speed over turning rate."""
    with World(small_site(TRUCK)) as world:
        operator = Operator(world)
        operator.drive("truck", 1.0, 0.5)
        operator.wait(5)
        first = world.telemetry("truck", 0).pose
        operator.wait(math.pi / 0.5)
        second = world.telemetry("truck", 0).pose
    assert first.distance(second) == pytest.approx(2 * 1.0 / 0.5, rel=0.01)


def test_tracks_halt_without_commands() -> None:
    """After the site's command_timeout_s of site time the machine brakes and stands."""
    with World(small_site(TRUCK)) as world:
        operator = Operator(world)
        operator.drive("truck", 2.0)
        operator.wait(2)
        operator.let_go()
        operator.wait(0.7)
        assert world.telemetry("truck", 0).speed_mps == pytest.approx(2.0)
        operator.wait(1.1)
        halted = world.telemetry("truck", 0)
        assert halted.speed_mps == 0
        operator.wait(1)
        assert world.telemetry("truck", 0).pose == halted.pose


def test_joints_halt_without_commands() -> None:
    """A long swing stops on the way."""
    with World(small_site({"digger": ("excavator", 0, 0, 0)})) as world:
        operator = Operator(world)
        operator.tool("digger", swing=3.0)
        operator.let_go()
        operator.wait(3)
        assert world.telemetry("digger", 0).joints["swing"] == pytest.approx(0.9, abs=0.9 * 2 * STEP_S)


def test_joints_keep_their_speed_and_range() -> None:
    """A target beyond the range is reached at its edge, no faster than the joint can."""
    with World(small_site({"digger": ("excavator", 0, 0, 0)})) as world:
        operator = Operator(world)
        operator.tool("digger", boom=9.0, swing=-0.9)
        operator.wait(0.5)
        joints = world.telemetry("digger", 0).joints
        assert joints["boom"] == pytest.approx(0.8 + 0.5 * 0.6)
        assert joints["swing"] == pytest.approx(-0.45)
        operator.wait(2)
        assert world.telemetry("digger", 0).joints["boom"] == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("robot_id", "command"),
    [
        ("nobody", DriveCommand(seq=0, speed_mps=1, turn_radps=0)),
        ("truck", ToolCommand(seq=0, joints={"bed": 1.0, "boom": 1.0})),
    ],
    ids=["unknown robot", "unknown joint"],
)
def test_a_command_that_cannot_be_obeyed_changes_nothing(robot_id: str, command: DriveCommand | ToolCommand) -> None:
    """The error says what there is, and not even the valid part is done."""
    with World(small_site(TRUCK)) as world:
        before = world.telemetry("truck", 0)
        with pytest.raises(CommandError, match=r"has no (robot|joint)"):
            world.command(robot_id, command)
        for _ in range(30):
            world.step()
        after = world.telemetry("truck", 0)
    assert (after.pose, after.joints) == (before.pose, before.joints)


def test_robots_driven_into_each_other_stop_and_the_contact_is_counted() -> None:
    """Both feel it, neither moves on, one contact is one count however long they push."""
    with World(small_site({"a": ("dump_truck", -5, 0.3, 0), "b": ("excavator", 5, 0, math.pi)})) as world:
        operator = Operator(world)
        operator.drive("a", 2.0)
        operator.drive("b", 1.5)
        operator.wait(8)
        a, b = world.telemetry("a", 0), world.telemetry("b", 0)
        assert (a.touching, b.touching) == (("b",), ("a",))
        assert b.pose.x - a.pose.x == pytest.approx(3.6, abs=0.02)
        assert world.truth().robot_contacts == 1
        operator.drive("a", -1.0)
        operator.drive("b", -1.0)
        operator.wait(2)
        assert world.telemetry("a", 0).touching == ()
        operator.drive("a", 2.0)
        operator.drive("b", 0.0)
        operator.wait(5)
        assert world.truth().robot_contacts == 2


@pytest.mark.parametrize("object_class", ["obstacle", "rock", "soil", "crate"])
def test_solid_things_stop_a_robot(object_class: str) -> None:
    """It stands before the thing, feels it, and can back away."""
    with World(small_site(TRUCK, [{**WALL, "class": object_class}])) as world:
        operator = Operator(world)
        operator.drive("truck", 2.5)
        operator.wait(6)
        stopped = world.telemetry("truck", 0)
        assert stopped.touching == ("obstacle1",)
        assert stopped.pose.x < 6 - 1.8
        operator.drive("truck", -1.0)
        operator.wait(3)
        assert world.telemetry("truck", 0).touching == ()
        assert world.telemetry("truck", 0).pose.x < stopped.pose.x - 1
        assert world.truth().robot_contacts == 0


@pytest.mark.parametrize("object_class", ["obstacle", "rock", "soil"])
def test_a_solid_thing_needs_no_height_in_the_file(object_class: str) -> None:
    """It is built as high as its radius lets expect, and stops a robot too."""
    thing = {"name": "thing", "class": object_class, "position": {"x": 6, "y": 0}, "radius_m": 1.0}
    camera = Camera(id="down", position=Point(x=6, y=0), height_m=20, width_px=64, height_px=64)
    with World(small_site(TRUCK, [thing])) as world:
        assert world.render(camera)[31, 32].tolist() != world.render(camera)[0, 0].tolist()
        operator = Operator(world)
        operator.drive("truck", 2.5)
        operator.wait(6)
        assert world.telemetry("truck", 0).touching == ("thing",)


def test_a_robot_cannot_turn_into_a_thing() -> None:
    """Its corners are solid too."""
    wall = {**WALL, "position": {"x": 0, "y": 1.9}}
    with World(small_site(TRUCK, [{**wall, "class": "rock", "radius_m": 0.7}])) as world:
        operator = Operator(world)
        operator.drive("truck", 0.0, 0.6)
        operator.wait(10)
        assert world.telemetry("truck", 0).touching == ("obstacle1",)
        assert abs(world.telemetry("truck", 0).pose.yaw) < 1.5


def test_a_puddle_is_driven_through() -> None:
    """Water stops nobody."""
    with World(small_site(TRUCK, [{**WALL, "class": "puddle", "height_m": 0}])) as world:
        operator = Operator(world)
        operator.drive("truck", 2.5)
        operator.wait(6)
        assert world.telemetry("truck", 0).touching == ()
        assert world.telemetry("truck", 0).pose.x > 8


def test_robots_that_start_inside_each_other_can_part() -> None:
    """What is pressed together may move apart but no deeper in."""
    with World(small_site({"a": ("carrier", 0, 0, 0), "b": ("carrier", 1, 0, 0)})) as world:
        operator = Operator(world)
        operator.drive("a", 1.0)
        operator.wait(2)
        assert world.telemetry("a", 0).pose.x < 0.05
        operator.drive("a", -1.0)
        operator.wait(4)
        assert world.telemetry("a", 0).pose.x < -2
        assert world.telemetry("a", 0).touching == ()


def test_the_same_commands_give_the_same_run() -> None:
    """Truth and pictures of a seed are identical, bit by bit."""

    def run() -> tuple[str, bytes]:
        site = load_site(YARD)
        with World(site, seed=5) as world:
            operator = Operator(world)
            for number, robot_id in enumerate(world.machines):
                operator.drive(robot_id, 1.0 + 0.2 * number, 0.1 * (number - 3))
            operator.wait(15)
            operator.dig("robot_excavator_01")
            return world.truth().model_dump_json(), world.render(site.cameras[0]).tobytes()

    assert run() == run()


def test_another_seed_looks_different_and_is_the_same_site() -> None:
    """Chance changes the looks only."""
    site = load_site(YARD)
    with World(site, seed=1) as one, World(site, seed=2) as other:
        assert one.render(site.cameras[0]).tobytes() != other.render(site.cameras[0]).tobytes()
        assert one.truth().soil == other.truth().soil


def test_the_world_ends_some_way_beyond_the_bounds() -> None:
    """A machine that nobody stops halts there, and can come back."""
    with World(small_site({"truck": ("dump_truck", 28, 0, 0)})) as world:
        operator = Operator(world)
        operator.drive("truck", 2.5)
        operator.wait(20)
        assert world.telemetry("truck", 0).pose.x == pytest.approx(50, abs=0.1)
        operator.drive("truck", -2.5)
        operator.wait(5)
        assert world.telemetry("truck", 0).pose.x < 45


def test_a_thing_may_not_have_the_name_of_a_robot() -> None:
    """Contacts could not be told apart."""
    with pytest.raises(SiteError, match="truck"):
        World(small_site(TRUCK, [{**WALL, "name": "truck"}]))
