"""Carries out effects: what is published once, and the requests that are sent until they are answered."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from muster_bus import Bus, crash
from muster_schemas.channels import (
    AREAS,
    KEYWORDS,
    MISSION_STATE,
    ROBOT_STOP,
    SKILL_REQUEST,
    STATUS_ACK,
    TASK_STATE,
)
from muster_schemas.robot import SkillRequest, TaskRef
from muster_schemas.rpc import ReplanMission
from muster_schemas.stops import StopRequest
from muster_schemas.world import Keywords

from .core.effects import (
    Acknowledge,
    AskPlanner,
    Effect,
    Hush,
    HushStop,
    LookFor,
    PublishAreas,
    PublishMission,
    PublishTask,
    RetractMission,
    RetractTask,
    Send,
    SendStop,
)

REPEAT_S: Final = 0.5
VALID_S: Final = 10.0
"""A request that arrives later than this after it was sent is refused: it was held up somewhere."""


_ToRobot = Send | Hush | SendStop | HushStop
_ToAll = Acknowledge | PublishTask | PublishMission | RetractTask | RetractMission | LookFor


@dataclass(slots=True)
class _Outstanding:
    request: SkillRequest | StopRequest
    next_at: float


class Outbox:
    """Everything that goes out on the bus."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._questions: list[ReplanMission] = []
        self._outstanding: dict[tuple[str, TaskRef | None], _Outstanding] = {}
        """By robot and attempt; None for its stop order, of which only the newest counts."""

    def carry_out(self, effects: Sequence[Effect], at: float, now: float) -> None:
        """Do the effects of one batch: what machines wait for first, and of several states of one thing only the last.

        Args:
            effects: in the order in which they arose; their events are in the journal.
            at: wall time for messages.
            now: monotonic time for repeats.

        """
        for effect in [e for e in effects if isinstance(e, PublishAreas)][-1:]:
            crash.point("send")
            self._bus.publish(AREAS, effect.rules)
        requests = [e for e in effects if isinstance(e, SendStop | HushStop | Send | Hush)]
        for effect in sorted(requests, key=lambda e: not isinstance(e, SendStop)):
            self._address(effect, at, now)
        told: dict[tuple[str, ...], _ToAll] = {}
        for effect in effects:
            match effect:
                case Acknowledge(ack=ack):
                    told["ack", ack.robot_id, ack.mission_id, ack.task_id, str(ack.attempt)] = effect
                case PublishTask(task=task):
                    told["task", *task.key] = effect
                case RetractTask():
                    told["task", effect.mission_id, effect.task_id] = effect
                case PublishMission(mission=mission):
                    told["mission", mission.mission_id] = effect
                case RetractMission():
                    told["mission", effect.mission_id] = effect
                case LookFor():
                    told["look", *effect.objects] = effect
                case _:
                    pass
        for effect in told.values():
            self._tell(effect)
        self._questions += [e.request for e in effects if isinstance(e, AskPlanner)]

    def take_questions(self) -> list[ReplanMission]:
        """Return what the planner is to be asked, and forget it."""
        questions, self._questions = self._questions, []
        return questions

    def repeat(self, at: float, now: float) -> None:
        """Send again what has waited long enough for an answer."""
        for outstanding in self._outstanding.values():
            if now >= outstanding.next_at:
                outstanding.next_at = now + REPEAT_S
                self._send(outstanding.request, at)

    def look_for(self, objects: Iterable[str]) -> None:
        """Ask the cameras for objects."""
        self._bus.publish(KEYWORDS, Keywords(keywords=tuple(objects)[:64], asked_by="scheduler"))

    def _address(self, effect: _ToRobot, at: float, now: float) -> None:
        crash.point("send")
        match effect:
            case Send(request=request):
                self._outstanding[request.robot_id, request.ref] = _Outstanding(request, now + REPEAT_S)
                self._send(request, at)
            case Hush():
                self._outstanding.pop((effect.robot_id, effect.ref), None)
            case SendStop(request=request):
                self._outstanding[request.robot_id, None] = _Outstanding(request, now + REPEAT_S)
                self._send(request, at)
            case HushStop():
                self._outstanding.pop((effect.robot_id, None), None)

    def _send(self, request: SkillRequest | StopRequest, at: float) -> None:
        if isinstance(request, StopRequest):
            fresh_stop = request.model_copy(update={"issued_at": at})
            self._bus.publish(ROBOT_STOP, fresh_stop, robot_id=request.robot_id)
            return
        fresh = request.model_copy(update={"issued_at": at, "deadline": at + VALID_S})
        self._bus.publish(SKILL_REQUEST, fresh, robot_id=request.robot_id, skill=request.skill)

    def _tell(self, effect: _ToAll) -> None:
        crash.point("send")
        match effect:
            case Acknowledge(ack=ack):
                self._bus.publish(STATUS_ACK, ack, robot_id=ack.robot_id, skill=effect.skill)
            case PublishTask(state=state):
                self._bus.publish(TASK_STATE, state, mission_id=state.mission_id, task_id=state.task_id)
            case PublishMission(state=state):
                self._bus.publish(MISSION_STATE, state, mission_id=state.mission_id)
            case RetractTask():
                self._bus.retract(TASK_STATE, mission_id=effect.mission_id, task_id=effect.task_id)
            case RetractMission():
                self._bus.retract(MISSION_STATE, mission_id=effect.mission_id)
            case LookFor():
                self.look_for(effect.objects)
