"""Between the simulator and the `sim` driver of a robot's agent."""

from typing import Annotated, Literal

from pydantic import Field, RootModel

from .base import Message, Point, Pose
from .ids import Id
from .robot import Load

JointName = Annotated[str, Field(min_length=1, max_length=32)]


class DriveCommand(Message):
    """Tracks: wanted speed forward and turning rate. Ends by itself after the site's `command_timeout_s`."""

    kind: Literal["drive"] = "drive"
    seq: int = Field(ge=0)
    speed_mps: float = Field(ge=-20, le=20)
    turn_radps: float = Field(ge=-10, le=10)


class ToolCommand(Message):
    """Joint positions to move to (rad): `swing boom arm bucket` of an excavator, `bed` of a dump truck."""

    kind: Literal["tool"] = "tool"
    seq: int = Field(ge=0)
    joints: dict[JointName, Annotated[float, Field(ge=-10, le=10)]]


class SimCommand(RootModel[Annotated[DriveCommand | ToolCommand, Field(discriminator="kind")]]):
    """Either command; JSON has it flat, told apart by `kind`."""

    def to_json(self) -> bytes:
        """Return the UTF-8 JSON that stands on the bus."""
        return self.model_dump_json().encode()


class Telemetry(Message):
    """A simulated robot's own sensors, 20 Hz of site time; also the agent's clock."""

    robot_id: Id
    seq: int = Field(ge=0)
    site_time_s: float = Field(ge=0, description="seconds of simulated time since the simulator began")
    pose: Pose
    speed_mps: float
    turn_radps: float
    joints: dict[JointName, float]
    load: Load
    touching: tuple[str, ...] = Field(default=(), description="robots or bodies that its hull is in contact with")


class SimBody(Message):
    """Truth about a robot or thing."""

    pose: Pose
    radius_m: float = Field(default=0.0, ge=0)
    load: Load = Load()


class SoilDeposit(Message):
    """Soil lying somewhere; `pile` names the soil pile that it is, if one."""

    position: Point
    soil_m3: float = Field(ge=0)
    pile: Id | None = None


class SimWorld(Message):
    """The truth, for tests and evaluation only; no service of the site may read it."""

    site_time_s: float = Field(ge=0)
    speed_factor: float = Field(gt=0, description="site seconds asked for each second")
    achieved_factor: float = Field(ge=0, description="site seconds reached each second, lately")
    robots: dict[Id, SimBody]
    things: dict[Id, SimBody] = Field(description="obstacles, rocks, puddles; those in a bucket are not listed")
    soil: tuple[SoilDeposit, ...]
    robot_contacts: int = Field(ge=0, description="times that two robots touched since the start")
