"""Writes the settings of the router for `zenohd`, which containers run: `python -m muster_bus.zenohd FILE`."""

import json
import sys
from pathlib import Path

from .session import router_settings

LISTEN = "tcp/0.0.0.0:7447"
_HEAD = "// Written by `make schemas` from muster_bus.session.router_settings; do not edit.\n"


def config_file() -> str:
    """Return the file's text: the same settings as the router in a Python process, for all networks of a container."""
    return _HEAD + json.dumps(router_settings([LISTEN]), indent=2) + "\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(config_file())
