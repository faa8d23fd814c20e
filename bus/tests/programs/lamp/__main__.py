"""A service as small as one can be, told by MUSTER_TROUBLE what to do wrong."""

import asyncio
import time

import structlog
from muster_bus import Bus
from muster_bus.runtime import run
from muster_bus.settings import ServiceSettings, read
from muster_schemas.channels import KEYWORDS, MISSIONS
from muster_schemas.rpc import MissionsQuery, MissionsReply
from muster_schemas.world import Keywords
from pydantic_settings import SettingsConfigDict


class LampSettings(ServiceSettings):
    """What goes wrong, and whom it is."""

    model_config = SettingsConfigDict(env_prefix="MUSTER_", frozen=True, extra="ignore")

    trouble: str = ""
    robot_id: str = ""
    drain_s: float = 1.0
    stall_limit_s: float = 5.0
    """How long its loop may stand still."""


settings = read(LampSettings)


async def never(_request: MissionsQuery) -> MissionsReply:
    """Keep whoever asks waiting."""
    structlog.stdlib.get_logger().info("asked")
    await asyncio.Event().wait()
    raise AssertionError


async def main(bus: Bus, stop: asyncio.Event) -> None:
    """Burn until asked to stop."""
    match settings.trouble:
        case "crash":
            async with bus.subscribe(KEYWORDS):
                raise RuntimeError("the lamp broke")
        case "stall":
            time.sleep(3600)  # noqa: ASYNC251  (the trouble that is wanted)
        case "deaf":
            await asyncio.Event().wait()
        case "slow":
            async with bus.serve(MISSIONS, never):
                await stop.wait()
        case _:
            pass
    await stop.wait()
    bus.publish(KEYWORDS, Keywords(keywords=("good night",), asked_by="lamp"))


run(
    "lamp",
    settings,
    main,
    identity=("robot", settings.robot_id) if settings.robot_id else None,
    drain_s=settings.drain_s,
    stall_limit_s=settings.stall_limit_s,
)
