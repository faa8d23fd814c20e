"""Stopping robots, one or all of them, until someone releases them again.

A stop is latched at the robot itself: its agent keeps it in its own journal and starts nothing before the release, so
it holds over restarts of every process. Orders are numbered, a higher number replaces a lower one, so late and
repeated ones do no harm.
"""

from pydantic import Field

from .base import Message, UnixTime
from .ids import Id
from .robot import TaskRef

NOT_REACHABLE = "not reachable: what it does is not known"
NO_ANSWER = "no answer yet"


class StopRequest(Message):
    """To one robot's agent, whichever life it is in; sent again until it answers that it has obeyed."""

    robot_id: Id
    number: int = Field(ge=1, description="milliseconds since 1970 at which it was ordered, or more; only ever grows")
    stopped: bool = Field(description="true: stand still and start nothing; false: released")
    issued_at: UnixTime


class StopStatus(Message):
    """An agent's word on the stop order with the highest number that it has seen."""

    robot_id: Id
    boot_id: Id
    number: int = Field(ge=1)
    stopped: bool
    standing: bool = Field(description="whether the machine stands still; a released one may")
    was_busy: bool = Field(default=False, description="whether a skill was under way when the order came")
    busy_with: TaskRef | None = Field(default=None, description="what goes on after the release")
    reason: str | None = Field(default=None, max_length=400, description="why it is not known to stand")
    at: UnixTime


class StopRobots(Message):
    """Stop or release one robot, or everything on the site; doing it twice equals doing it once."""

    robot_id: Id | None = Field(default=None, description="left out: every robot, and those that are yet to come")
    stop: bool = True


class StopReply(Message):
    """What is known of each robot that was meant: 'stopped', 'was idle', 'released', or why nothing is known."""

    site_stopped: bool = Field(description="whether the whole site is stopped")
    robots: dict[Id, str] = Field(default_factory=dict)
