"""What the simulator reads from its environment."""

from typing import Annotated

from muster_bus.settings import ServiceSettings
from pydantic import Field


class SimSettings(ServiceSettings):
    """The common settings, and how fast site time passes."""

    speed_factor: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)] = 1.0
    """Site seconds a second (MUSTER_SPEED_FACTOR)."""
