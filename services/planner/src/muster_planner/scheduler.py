"""What the planner asks of the scheduler."""

from muster_bus import Bus, NoReplyError, RefusedError
from muster_schemas.channels import CONTROL, MISSIONS, STOP, SUBMIT
from muster_schemas.mission import MissionStatus, MissionView, Reason
from muster_schemas.plan import Plan
from muster_schemas.rpc import (
    ControlMission,
    ControlReply,
    ErrorCode,
    MissionAction,
    MissionsQuery,
    MissionsReply,
    SubmitMission,
)
from muster_schemas.stops import StopReply, StopRobots

_SUBMIT_TRIES = 3

_ACT_S = 4.0
"""A cancel is answered only after the robots had a moment to say that they have stopped."""

_SET_PLAN_S = 8.0
"""The scheduler's gate waits for objects that the cameras are still looking for."""


class Scheduler:
    """Typed calls; each raises `NoReplyError` or `RefusedError` of the bus."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    async def submit(self, mission: SubmitMission) -> ControlReply:
        """Make a mission. It must have an idempotency key, so that asking again cannot make a second one."""
        if mission.idempotency_key is None:
            raise ValueError("a mission is submitted with an idempotency key")
        for left in reversed(range(_SUBMIT_TRIES)):
            try:
                reply: ControlReply = await self._bus.ask(SUBMIT, mission)
            except NoReplyError:
                if not left:
                    raise
            else:
                return reply
        raise AssertionError("unreachable: the last try returns or raises")

    async def act(
        self, mission_id: str, action: MissionAction, task_id: str | None = None, plan_revision: int | None = None
    ) -> ControlReply:
        """Do one thing with a mission, or about one of its tasks."""
        request = ControlMission(mission_id=mission_id, action=action, task_id=task_id, plan_revision=plan_revision)
        reply: ControlReply = await self._bus.ask(CONTROL, request, timeout_s=_ACT_S)
        return reply

    async def stop(self, robot_id: str | None, *, stop: bool) -> StopReply:
        """Stop or release a robot, or all."""
        reply: StopReply = await self._bus.ask(STOP, StopRobots(robot_id=robot_id, stop=stop), timeout_s=_ACT_S)
        return reply

    async def set_plan(self, mission_id: str, plan: Plan, plan_revision: int | None = None) -> ControlReply:
        """Give a mission its plan, or one edited from a revision; the gate's reasons come back in the refusal."""
        request = ControlMission(
            mission_id=mission_id, action=MissionAction.SET_PLAN, plan=plan, plan_revision=plan_revision
        )
        reply: ControlReply = await self._bus.ask(CONTROL, request, timeout_s=_SET_PLAN_S)
        return reply

    async def refuse(self, mission_id: str, reasons: tuple[Reason, ...]) -> ControlReply:
        """Say that a mission cannot be planned."""
        request = ControlMission(mission_id=mission_id, action=MissionAction.REFUSE, reasons=reasons)
        reply: ControlReply = await self._bus.ask(CONTROL, request)
        return reply

    async def mission(self, mission_id: str) -> MissionView | None:
        """Return one mission, or None if there is none of that id."""
        try:
            found = await self._read(MissionsQuery(mission_id=mission_id))
        except RefusedError as error:
            if error.error.code is ErrorCode.NOT_FOUND:
                return None
            raise
        return found[0] if found else None

    async def missions(self, states: tuple[MissionStatus, ...], limit: int) -> tuple[MissionView, ...]:
        """Return missions, newest first."""
        return await self._read(MissionsQuery(states=states, limit=limit))

    async def _read(self, query: MissionsQuery) -> tuple[MissionView, ...]:
        reply: MissionsReply = await self._bus.ask(MISSIONS, query)
        return reply.missions
