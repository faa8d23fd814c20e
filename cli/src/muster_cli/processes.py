"""Which processes make up a site on this machine, and with which settings each one runs."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from muster_schemas.base import Message
from muster_schemas.site import Site

ROUTER = "router"
Driver = Literal["sim", "kinematic"]


class Process(Message):
    """One process that the supervisor keeps running."""

    name: str
    argv: tuple[str, ...]
    env: dict[str, str] = {}  # noqa: RUF012  (pydantic copies it)


class Plan(Message):
    """Everything that the supervisor of a site must know; lies in the data directory as `wanted.json`."""

    site: str
    site_file: str
    endpoint: str
    url: str
    speed_factor: float
    driver: Driver
    planner: str
    first: Process
    """The router: the others start once it listens."""
    rest: tuple[Process, ...]


class Options(Message):
    """What the operator may choose about a site that runs on this machine."""

    site_file: Path
    data_dir: Path
    bus_port: int
    port: int
    speed_factor: float
    driver: Driver
    planner: str
    log_level: str


def plan_of(site: Site, options: Options) -> Plan:
    """Return the table of processes for `site`.

    Robots with the `kinematic` driver move by themselves; the simulator then serves only what the cameras see.
    """
    endpoint = f"tcp/127.0.0.1:{options.bus_port}"
    common = {
        "MUSTER_SITE_FILE": str(options.site_file.resolve()),
        "MUSTER_DATA_DIR": str(options.data_dir.resolve()),
        "MUSTER_CONNECT": endpoint,
        "MUSTER_LOG_LEVEL": options.log_level,
    }
    speed = {"MUSTER_SPEED_FACTOR": str(options.speed_factor)}
    operators = {"MUSTER_HOST": "127.0.0.1", "MUSTER_PORT": str(options.port), "MUSTER_PLANNER": options.planner}
    agents = (
        _process(
            r.id, "muster_robot_agent", common | speed | {"MUSTER_ROBOT_ID": r.id, "MUSTER_DRIVER": options.driver}
        )
        for r in site.robots
    )
    return Plan(
        site=site.name,
        site_file=str(options.site_file),
        endpoint=endpoint,
        url=f"http://127.0.0.1:{options.port}",
        speed_factor=options.speed_factor,
        driver=options.driver,
        planner=options.planner,
        first=_process(ROUTER, "muster_bus.router", common | {"MUSTER_LISTEN": endpoint}),
        rest=(
            _process("sim", "muster_sim", common | speed),
            _process("vision", "muster_vision", common),
            _process("scheduler", "muster_scheduler", common),
            _process("planner", "muster_planner", common | operators),
            *agents,
        ),
    )


def _process(name: str, module: str, env: Mapping[str, str]) -> Process:
    return Process(name=name, argv=(sys.executable, "-m", module), env=dict(env))
