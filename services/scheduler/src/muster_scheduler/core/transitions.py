"""The tables of what may follow what. Anything else is a bug, and the error tells the task's recent story."""

from collections.abc import Iterable
from typing import Final

from muster_schemas.mission import MissionStatus as M
from muster_schemas.mission import TaskStatus as T

TASK_MOVES: Final[dict[tuple[T, T], str]] = {
    (T.WAITING, T.READY): "its dependencies are done",
    (T.WAITING, T.SKIPPED): "a task that it depends on did not succeed",
    (T.WAITING, T.CANCELLED): "its mission was cancelled",
    (T.READY, T.DISPATCHED): "its robots are reserved and have their requests",
    (T.READY, T.FAILED): "it cannot be done, or what it needs did not come in time",
    (T.READY, T.SKIPPED): "it failed, and a person goes on without it",
    (T.READY, T.CANCELLED): "its mission was cancelled",
    (T.DISPATCHED, T.RUNNING): "a robot has started",
    (T.DISPATCHED, T.PAUSED): "its robots are paused",
    (T.DISPATCHED, T.READY): "the attempt did not work and may be repeated",
    (T.DISPATCHED, T.SUCCEEDED): "all its robots are done",
    (T.DISPATCHED, T.FAILED): "the attempt did not work",
    (T.DISPATCHED, T.CANCELLED): "its mission was cancelled",
    (T.RUNNING, T.PAUSED): "its robots are paused",
    (T.RUNNING, T.READY): "the attempt did not work and may be repeated",
    (T.RUNNING, T.SUCCEEDED): "all its robots are done",
    (T.RUNNING, T.FAILED): "the attempt did not work",
    (T.RUNNING, T.CANCELLED): "its mission was cancelled",
    (T.PAUSED, T.RUNNING): "its robots go on",
    (T.PAUSED, T.READY): "the attempt did not work and may be repeated",
    (T.PAUSED, T.SUCCEEDED): "all its robots are done",
    (T.PAUSED, T.FAILED): "the attempt did not work",
    (T.PAUSED, T.CANCELLED): "its mission was cancelled",
}

MISSION_MOVES: Final[dict[tuple[M, M], str]] = {
    (M.PLANNING, M.REJECTED): "it cannot be planned",
    (M.PLANNING, M.AWAITING_APPROVAL): "it is planned and a person wants to see it first",
    (M.PLANNING, M.RUNNING): "it is planned",
    (M.PLANNING, M.CANCELLED): "cancelled before it was planned",
    (M.AWAITING_APPROVAL, M.REJECTED): "a person does not want it",
    (M.AWAITING_APPROVAL, M.RUNNING): "a person wants it",
    (M.AWAITING_APPROVAL, M.CANCELLED): "cancelled before it was approved",
    (M.RUNNING, M.PAUSED): "a person paused it",
    (M.RUNNING, M.SUCCEEDED): "every task succeeded",
    (M.RUNNING, M.FAILED): "every task ended, not all with success",
    (M.RUNNING, M.CANCELLED): "cancelled, and no robot is at it any more",
    (M.PAUSED, M.RUNNING): "a person resumed it",
    (M.PAUSED, M.SUCCEEDED): "the last task succeeded before its robot paused",
    (M.PAUSED, M.FAILED): "the last task ended before its robot paused",
    (M.PAUSED, M.CANCELLED): "cancelled, and no robot is at it any more",
}


class InvalidTransition(RuntimeError):  # noqa: N818  (the name that the design gives it)
    """A move that no table has; carries the last things that happened to the task or mission."""

    def __init__(self, what: str, start: str, finish: str, story: Iterable[str] = ()) -> None:
        self.story = tuple(story)
        super().__init__(f"{what} cannot go from {start} to {finish}; before: {'; '.join(self.story) or 'nothing'}")
