"""The port between an agent and a machine."""

from collections.abc import AsyncGenerator
from typing import Protocol

from muster_schemas.sim import Telemetry

from muster_robot_agent.machine import Order


class Driver(Protocol):
    """A machine that can be felt and moved. It halts by itself when no order comes for the site's command timeout."""

    def telemetry(self) -> AsyncGenerator[Telemetry]:
        """Yield what the machine senses, newest only, 20 Hz of site time; the agent's clock."""
        ...

    def apply(self, order: Order, site_time_s: float) -> None:
        """Send what the machine is to do now; `site_time_s` is the time of the telemetry that it answers."""
        ...
