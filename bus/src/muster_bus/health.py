"""Whether one service or robot of the site is alive, for containers: `python -m muster_bus.health service scheduler`.

Exit code 0 if its liveliness token is there, 1 if not. A process whose loop stands still ends itself (see `watchdog`),
so a token means that it works.
"""

import asyncio
import sys

from muster_schemas.channels import ROBOT_ALIVE, SERVICE_ALIVE
from muster_schemas.ids import check_id
from muster_schemas.site import load_site

from . import logs
from .bus import open_bus
from .settings import ServiceSettings, read

_WITHIN_S = 8.0
_USAGE = "usage: python -m muster_bus.health service|robot NAME\n"


async def is_alive(settings: ServiceSettings, kind: str, name: str) -> bool:
    """Return whether the token of a service or robot is on the bus; False also if no router answers in time."""
    site = load_site(settings.site_file).name
    try:
        async with asyncio.timeout(_WITHIN_S), open_bus(site, settings.connect) as bus:
            if kind == "robot":
                return bool(await bus.who_is_alive(ROBOT_ALIVE, robot_id=name))
            return bool(await bus.who_is_alive(SERVICE_ALIVE, service=name))
    except TimeoutError:
        return False


def main(arguments: list[str]) -> int:
    """Return the exit code for `service NAME` or `robot NAME`."""
    if len(arguments) != 2 or arguments[0] not in ("service", "robot"):
        sys.stderr.write(_USAGE)
        return 2
    settings = read(ServiceSettings)
    logs.set_up("error", service="health")
    return 0 if asyncio.run(is_alive(settings, arguments[0], check_id(arguments[1]))) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
