"""What an agent reads from its environment, once."""

from pathlib import Path
from typing import Annotated, Literal

from muster_bus.settings import ServiceSettings
from muster_schemas.ids import Id
from pydantic import BeforeValidator, Field, model_validator
from pydantic_settings import NoDecode


def _split(value: object) -> object:
    """Read `a,b` from an environment variable."""
    if isinstance(value, str):
        return tuple(part.strip() for part in value.split(",") if part.strip())
    return value


class HostSettings(ServiceSettings):
    """How the machines of a process behave, whichever they are."""

    speed_factor: float = Field(default=1.0, gt=0, le=1000)
    """Of the kinematic driver: seconds on the site for each second."""
    history_file: Path | None = None
    """Where each physical start and end is written, for tests."""


class AgentSettings(HostSettings):
    """Which robots this process speaks for, and how it reaches their machines."""

    robot_id: Annotated[tuple[Id, ...], NoDecode, BeforeValidator(_split), Field(min_length=1)]
    """One robot; with the kinematic driver several, separated by commas."""
    driver: Literal["sim", "kinematic"] = "sim"

    @model_validator(mode="after")
    def _one_machine_each(self) -> "AgentSettings":
        if len(set(self.robot_id)) != len(self.robot_id):
            raise ValueError("MUSTER_ROBOT_ID names a robot twice")
        if self.driver == "sim" and len(self.robot_id) > 1:
            raise ValueError("only MUSTER_DRIVER=kinematic can have several robots in one process")
        return self
