"""The channel table: every key on the bus, with its model, kind, rate and owner. No key stands anywhere else.

`docs/channels.md` is generated from it (`python -m muster_schemas.export`).
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, Generic, TypeVar

from pydantic import BaseModel

from . import mission, robot, rpc, sim, stops, world
from .ids import check_id

M = TypeVar("M", bound=BaseModel)

_FIELD = re.compile(r"{(\w+)}")


class Kind(StrEnum):
    """How messages on a channel behave."""

    EVENT = "event"
    """Something happened; each one counts."""
    STATE = "state"
    """Last value kept: its owner answers a query on the key, so late joiners get it."""
    COMMAND = "command"
    """Someone is to do something."""
    STREAM = "stream"
    """Periodic; only the newest counts, old ones are dropped when a reader is slow."""
    QUERY = "query"
    """Request and reply."""
    LIVELINESS = "liveliness"
    """A token that exists as long as the process has its link."""


@dataclass(frozen=True)
class Channel(Generic[M]):
    """One row of the table."""

    name: str
    template: str
    model: type[M]
    kind: Kind
    owner: str
    what: str
    rate_hz: float | None = None
    reply: type[BaseModel] | None = None
    binary: bool = False
    """The payload is not the model's JSON but bytes; the model's JSON stands in the attachment."""

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """The names of the ids in the key, in order."""
        return tuple(_FIELD.findall(self.template))

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        return re.compile(_FIELD.sub(r"(?P<\1>[a-z0-9_-]{1,64})", self.template))

    def key(self, **ids: str) -> str:
        """Return the key for these ids; an id that is left out becomes `*`.

        Raises:
            InvalidIdError: an id has characters that a key may not have.
            TypeError: an id that this channel does not have.

        """
        unknown = ids.keys() - self.fields
        if unknown:
            raise TypeError(f"channel {self.name} has no {', '.join(sorted(unknown))}")
        checked = {f: check_id(ids[f], f) if f in ids else "*" for f in self.fields}
        return self.template.format(**checked)

    def ids(self, key: str) -> dict[str, str] | None:
        """Return the ids in a key, or None if it is none of this channel's or holds a bad id."""
        match = self._pattern.fullmatch(key)
        return match.groupdict() if match else None


class _Token(BaseModel):
    """Liveliness tokens have no payload."""


def _c(name: str, template: str, model: type[M], kind: Kind, owner: str, what: str, **rest: Any) -> Channel[M]:
    return Channel(name, f"muster/{{site}}/{template}", model, kind, owner, what, **rest)


MISSION_STATE = _c(
    "mission_state",
    "missions/{mission_id}/state",
    mission.MissionState,
    Kind.STATE,
    "scheduler",
    "where a mission stands",
)
TASK_STATE = _c(
    "task_state",
    "missions/{mission_id}/tasks/{task_id}/state",
    mission.TaskState,
    Kind.STATE,
    "scheduler",
    "where a task stands and what it waits for",
)
SKILL_REQUEST = _c(
    "skill_request",
    "robots/{robot_id}/skills/{skill}/request",
    robot.SkillRequest,
    Kind.COMMAND,
    "scheduler",
    "start, cancel, pause, resume or query one attempt of a task; sent again until answered",
)
SKILL_STATUS = _c(
    "skill_status",
    "robots/{robot_id}/skills/{skill}/status",
    robot.SkillStatus,
    Kind.EVENT,
    "robot-agent",
    "how an attempt stands; the final one is sent again until acknowledged",
)
STATUS_ACK = _c(
    "status_ack",
    "robots/{robot_id}/skills/{skill}/ack",
    robot.StatusAck,
    Kind.EVENT,
    "scheduler",
    "a status is in the scheduler's journal",
)
ROBOT_STOP = _c(
    "robot_stop",
    "robots/{robot_id}/stop/request",
    stops.StopRequest,
    Kind.COMMAND,
    "scheduler",
    "stop a robot or release it; sent again until answered",
)
ROBOT_STOP_STATUS = _c(
    "robot_stop_status",
    "robots/{robot_id}/stop/status",
    stops.StopStatus,
    Kind.EVENT,
    "robot-agent",
    "whether a robot has obeyed a stop, and stands",
)
ROBOT_CARD = _c(
    "robot_card",
    "robots/{robot_id}/card",
    robot.RobotCard,
    Kind.STATE,
    "robot-agent",
    "type, skills, limits, home, boot id",
)
ROBOT_STATE = _c(
    "robot_state",
    "robots/{robot_id}/state",
    robot.RobotState,
    Kind.STREAM,
    "robot-agent",
    "pose, speed, load, path, task",
    rate_hz=5.0,
)
ROBOT_ALIVE = _c(
    "robot_alive",
    "robots/{robot_id}/alive/{boot_id}",
    _Token,
    Kind.LIVELINESS,
    "robot-agent",
    "exists while the agent has its link",
)
SERVICE_ALIVE = _c(
    "service_alive",
    "services/{service}/alive/{boot_id}",
    _Token,
    Kind.LIVELINESS,
    "each service",
    "exists while the service has its link",
)
OBJECT = _c(
    "object",
    "objects/{object_name}",
    world.MapObject,
    Kind.STATE,
    "vision",
    "one object of the map; deleted when it has gone",
)
KEYWORDS = _c(
    "keywords",
    "vision/keywords",
    world.Keywords,
    Kind.COMMAND,
    "planner, scheduler",
    "what to look for now",
)
AREAS = _c("areas", "areas", world.AreaRules, Kind.STATE, "scheduler", "who keeps out of what")
CAMERA_IMAGE = _c(
    "camera_image",
    "cameras/{camera_id}/image",
    world.CameraFrame,
    Kind.STREAM,
    "sim or a UAV",
    "JPEG; pose, intrinsics and time in the attachment",
    rate_hz=1.0,
    binary=True,
)
SIM_COMMAND = _c(
    "sim_command",
    "sim/robots/{robot_id}/command",
    sim.SimCommand,
    Kind.COMMAND,
    "robot-agent (sim driver)",
    "drive or move the tool",
    rate_hz=20.0,
)
SIM_TELEMETRY = _c(
    "sim_telemetry",
    "sim/robots/{robot_id}/telemetry",
    sim.Telemetry,
    Kind.STREAM,
    "sim",
    "a robot's own sensors",
    rate_hz=20.0,
)
SIM_WORLD = _c(
    "sim_world", "sim/world", sim.SimWorld, Kind.STREAM, "sim", "the truth, for tests and evaluation only", rate_hz=2.0
)
SUBMIT = _c(
    "submit",
    "scheduler/rpc/submit",
    rpc.SubmitMission,
    Kind.QUERY,
    "scheduler",
    "make a mission",
    reply=rpc.ControlReply,
)
CONTROL = _c(
    "control",
    "scheduler/rpc/control",
    rpc.ControlMission,
    Kind.QUERY,
    "scheduler",
    "act on a mission",
    reply=rpc.ControlReply,
)
MISSIONS = _c(
    "missions",
    "scheduler/rpc/missions",
    rpc.MissionsQuery,
    Kind.QUERY,
    "scheduler",
    "read missions",
    reply=rpc.MissionsReply,
)
STOP = _c(
    "stop",
    "scheduler/rpc/stop",
    stops.StopRobots,
    Kind.QUERY,
    "scheduler",
    "stop or release a robot or all",
    reply=stops.StopReply,
)
RULES = _c(
    "rules",
    "scheduler/rpc/rules",
    rpc.RulesQuery,
    Kind.QUERY,
    "scheduler",
    "read the area rules",
    reply=world.AreaRules,
)
REPLAN = _c(
    "replan",
    "planner/rpc/replan",
    rpc.ReplanMission,
    Kind.QUERY,
    "planner",
    "a new plan for the rest of a mission",
    reply=rpc.ReplanReply,
)

CHANNELS: tuple[Channel[Any], ...] = (
    MISSION_STATE, TASK_STATE, SKILL_REQUEST, SKILL_STATUS, STATUS_ACK, ROBOT_STOP, ROBOT_STOP_STATUS, ROBOT_CARD,
    ROBOT_STATE, ROBOT_ALIVE, SERVICE_ALIVE, OBJECT, KEYWORDS, AREAS, CAMERA_IMAGE, SIM_COMMAND, SIM_TELEMETRY,
    SIM_WORLD, SUBMIT, CONTROL, MISSIONS, STOP, RULES, REPLAN,
)  # fmt: skip


def all_of(site: str) -> str:
    """Return the key expression of everything on a site, for monitors."""
    return f"muster/{check_id(site, 'site')}/**"


def find(key: str) -> tuple[Channel[Any], dict[str, str]] | None:
    """Return the channel of a concrete key and its ids, or None for a key that is not in the table."""
    for channel in CHANNELS:
        ids = channel.ids(key)
        if ids is not None:
            return channel, ids
    return None
