"""What the planner asks of the scheduler."""

from muster_bus import Bus, NoReplyError, RefusedError
from muster_schemas.channels import CONTROL, MISSIONS, SUBMIT
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

    async def act(self, mission_id: str, action: MissionAction) -> ControlReply:
        """Do one thing with a mission."""
        request = ControlMission(mission_id=mission_id, action=action)
        reply: ControlReply = await self._bus.ask(CONTROL, request, timeout_s=_ACT_S)
        return reply

    async def set_plan(self, mission_id: str, plan: Plan) -> ControlReply:
        """Give a mission its plan; the gate's reasons come back in the refusal."""
        request = ControlMission(mission_id=mission_id, action=MissionAction.SET_PLAN, plan=plan)
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
