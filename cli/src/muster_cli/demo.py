"""`muster demo`: the whole site for one real instruction, judged by where the soil is afterwards.

It is an evaluation, so it may read the simulator's truth; nothing of the site does.
"""

import asyncio
import shutil
import socket
import time
from dataclasses import dataclass

from muster_bus import open_bus
from muster_schemas.channels import SIM_WORLD
from muster_schemas.mission import MissionStatus, MissionView
from muster_schemas.sim import SimWorld
from rich.console import Console
from rich.table import Table

from . import site
from .errors import CliError
from .follow import follow
from .processes import Plan
from .record import DataDirectory
from .rest import OperatorApi
from .settings import CliSettings
from .views import bars, seconds

INSTRUCTION = (
    "Excavator 1 and dump truck 1 go to the soil pile. Excavator 1 digs and unloads into the truck, which then hauls "
    "it to the puddle and tips. Meanwhile truck 2 has a look at the rock and comes home."
)
_TRUTH_WITHIN_S = 60.0
_SPILT_M3 = 0.05
_BUCKETFUL_M3 = 0.1
_AT_PUDDLE_M = 1.5
_BESIDE_BARS = 48
"""Columns of the terminal that the tasks' names and robots take."""


@dataclass(frozen=True)
class Soil:
    """Where the demo's soil is, in cubic metres."""

    pile: float
    truck: float
    puddle: float

    @classmethod
    def of(cls, world: SimWorld) -> "Soil":
        """Read it from the simulator's truth; what lies within 1.5 m of the puddle's edge lies at the puddle."""
        puddle = world.things["puddle1"]
        return cls(
            pile=sum(d.soil_m3 for d in world.soil if d.pile == "soil1"),
            truck=world.robots["robot_dump_truck_01"].load.soil_m3,
            puddle=sum(
                d.soil_m3
                for d in world.soil
                if d.position.distance(puddle.pose) <= puddle.radius_m + _AT_PUDDLE_M and d.pile is None
            ),
        )

    def problems(self, before: "Soil") -> list[str]:
        """Return what is not as the instruction wants it."""
        moved = self.puddle - before.puddle
        found: list[str] = []
        if moved < _BUCKETFUL_M3:
            found.append(f"Only {moved:.2f} m³ more lie at the puddle.")
        if self.truck > _SPILT_M3:
            found.append(f"{self.truck:.2f} m³ are still in the truck.")
        if abs((before.pile - self.pile) - moved) > _SPILT_M3:
            found.append(f"The pile lost {before.pile - self.pile:.2f} m³, the puddle got {moved:.2f} m³.")
        return found


def demo(settings: CliSettings, speed: float, console: Console) -> bool:
    """Run the demo on free ports and in a data directory of its own; returns whether the soil is where it belongs."""
    own = settings.model_copy(update={"data_dir": settings.data_dir / "demo"})
    directory = DataDirectory(own.data_dir)
    if directory.held():
        raise CliError("A demo is under way already in this checkout; wait for its end.")
    shutil.rmtree(own.data_dir, ignore_errors=True)
    port, bus_port = _free_ports(2)
    chosen = site.options(own, None, speed=speed, port=port, bus_port=bus_port, driver="sim", planner="embedded")
    console.rule("1  The site starts")
    record = site.up(chosen, console)
    try:
        return _show(record.plan, settings, console)
    finally:
        site.down(own.data_dir, console)


def _show(plan: Plan, settings: CliSettings, console: Console) -> bool:
    before = asyncio.run(_truth(plan))
    console.rule("2  One instruction")
    console.print(f'muster run "{INSTRUCTION}"', style="bold", soft_wrap=True, highlight=False)
    began = time.monotonic()
    token = settings.token.get_secret_value() if settings.token else None
    with OperatorApi(plan.url, token) as api:
        view = follow(api, api.submit(INSTRUCTION, 5, "auto"), console)
    wall_s = time.monotonic() - began
    after = asyncio.run(_truth(plan))
    console.rule("3  What came of it")
    console.print(bars(view.tasks, width=max(20, console.width - _BESIDE_BARS)))
    console.print(_soil_table(Soil.of(before), Soil.of(after)))
    site_s = after.site_time_s - before.site_time_s
    console.print(
        f"{seconds(wall_s)} on the clock, {seconds(site_s)} on the site ({site_s / wall_s:.1f} times as fast); "
        f"robots touched each other {after.robot_contacts - before.robot_contacts} times.",
        highlight=False,
    )
    return _verdict(view, Soil.of(after).problems(Soil.of(before)), console)


def _verdict(view: MissionView, problems: list[str], console: Console) -> bool:
    if view.mission.state is not MissionStatus.SUCCEEDED:
        problems = [f"The mission {view.mission.state.value}.", *problems]
    for problem in problems:
        console.print(problem, style="bold red")
    if not problems:
        console.print("The soil is where it belongs.", style="bold green")
    return not problems


def _soil_table(before: Soil, after: Soil) -> Table:
    table = Table(title="soil in m³", box=None, pad_edge=False, header_style="dim")
    for column in ("", "before", "after"):
        table.add_column(column, justify="right")
    for where in ("pile", "truck", "puddle"):
        table.add_row(where, f"{getattr(before, where):.2f}", f"{getattr(after, where):.2f}")
    return table


async def _truth(plan: Plan) -> SimWorld:
    """Return the simulator's truth as of now."""
    try:
        async with (
            asyncio.timeout(_TRUTH_WITHIN_S),
            open_bus(plan.site, [plan.endpoint]) as bus,
            bus.subscribe(SIM_WORLD) as messages,
        ):
            async for received in messages:
                if received.message is not None:
                    return received.message
    except TimeoutError:
        pass
    raise CliError("The simulator does not tell its state; see its log.")


def _free_ports(count: int) -> list[int]:
    probes = [socket.socket() for _ in range(count)]
    for probe in probes:
        probe.bind(("127.0.0.1", 0))
    ports = [int(probe.getsockname()[1]) for probe in probes]
    for probe in probes:
        probe.close()
    return ports
