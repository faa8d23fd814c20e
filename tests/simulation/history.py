"""What happened, as seen from outside of the system: the only thing that the invariants are checked against."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from muster_schemas.mission import MissionState, TaskState
from muster_schemas.robot import SkillRequest, TaskRef

What = Literal["start", "end", "halt"]


@dataclass(frozen=True)
class Motion:
    """A machine began an attempt, ended it, or was halted because its agent had gone."""

    at: float
    what: What
    robot_id: str
    ref: TaskRef
    epoch: int
    outcome: str = ""
    """Of an end."""
    request: SkillRequest | None = field(default=None, compare=False)
    """Of a start."""

    def __str__(self) -> str:
        said = f" {self.outcome}" if self.outcome else ""
        return f"{self.robot_id} {self.what}s {named(self.ref)} (epoch {self.epoch}){said}"


@dataclass(frozen=True)
class Heard:
    """A request reached an agent; `memory` tells one journal of the robot from the next."""

    at: float
    robot_id: str
    memory: int
    request: SkillRequest

    def __str__(self) -> str:
        request = self.request
        return f"{self.robot_id} hears {request.action} {named(request.ref)} (epoch {request.epoch})"


@dataclass(frozen=True)
class Published:
    """The scheduler told the site a mission's or task's state."""

    at: float
    state: MissionState | TaskState

    def __str__(self) -> str:
        state = self.state
        what = f"{state.mission_id}/{state.task_id}" if isinstance(state, TaskState) else state.mission_id
        return f"scheduler: {what} is {state.state}"


@dataclass(frozen=True)
class Answered:
    """The operator got an answer of success: `action` is "submit" or a control action."""

    at: float
    action: str
    mission_id: str
    robots: dict[str, str] = field(default_factory=dict[str, str])

    def __str__(self) -> str:
        return f"operator: {self.action} {self.mission_id} is answered {self.robots or ''}"


@dataclass(frozen=True)
class Trouble:
    """What the script did to the site."""

    at: float
    what: str

    def __str__(self) -> str:
        return f"-- {self.what}"


Record = Motion | Heard | Published | Answered | Trouble


class History:
    """Append-only."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def add(self, record: Record) -> None:
        """Note what has happened."""
        self.records.append(record)

    def motions(self) -> Iterator[Motion]:
        """Yield what the machines did."""
        return (r for r in self.records if isinstance(r, Motion))

    def heard(self, robot_id: str) -> Iterator[Heard]:
        """Yield the requests that reached a robot's agent."""
        return (r for r in self.records if isinstance(r, Heard) and r.robot_id == robot_id)

    def lines(self) -> list[str]:
        """Return it for a person, repeated states and requests left out."""
        found: list[str] = []
        seen: dict[str, str] = {}
        for record in self.records:
            text = str(record)
            if isinstance(record, Published | Heard):
                key = text.rsplit(" ", 1)[0] if isinstance(record, Published) else record.robot_id
                if seen.get(key) == text:
                    continue
                seen[key] = text
            found.append(f"{record.at:8.3f} {text}")
        return found


def named(ref: TaskRef) -> str:
    """Return an attempt in short."""
    return f"{ref.mission_id}/{ref.task_id}#{ref.attempt}"
