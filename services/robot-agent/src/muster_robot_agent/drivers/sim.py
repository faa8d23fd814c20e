"""The `sim` driver: a machine of the simulator, over the bus."""

from collections.abc import AsyncGenerator

from muster_bus import Bus
from muster_schemas.channels import SIM_COMMAND, SIM_TELEMETRY
from muster_schemas.sim import DriveCommand, SimCommand, Telemetry, ToolCommand

from muster_robot_agent.kinematics import Joints
from muster_robot_agent.machine import Order

_SPEED_STEP = 0.04
_TURN_STEP = 0.03
_JOINT_STEP = 0.005


class SimDriver:
    """Sends commands when they change, and often enough to be obeyed: machines halt without them."""

    def __init__(self, bus: Bus, robot_id: str, command_timeout_s: float) -> None:
        self._bus = bus
        self._robot_id = robot_id
        self._keep_alive_s = 0.4 * command_timeout_s
        self._seq = 0
        self._drive: tuple[float, float] = (0.0, 0.0)
        self._drive_at = self._tool_at = float("-inf")
        self._joints: Joints = {}

    async def telemetry(self) -> AsyncGenerator[Telemetry]:
        """Yield the newest telemetry of this robot as it comes."""
        async with self._bus.subscribe(SIM_TELEMETRY, robot_id=self._robot_id) as messages:
            async for received in messages:
                if received.message is not None and received.message.robot_id == self._robot_id:
                    yield received.message

    def apply(self, order: Order, site_time_s: float) -> None:
        """Send what has changed, and what is under way again before it runs out."""
        if site_time_s < self._drive_at:
            # the simulator has begun anew
            self._drive_at = self._tool_at = float("-inf")
        self._apply_drive(order, site_time_s)
        self._apply_tool(order, site_time_s)

    def _apply_drive(self, order: Order, site_time_s: float) -> None:
        wanted = (order.speed_mps, order.turn_radps)
        speed_before, turn_before = self._drive
        stops = wanted == (0.0, 0.0) != self._drive
        faster, turned = abs(wanted[0] - speed_before), abs(wanted[1] - turn_before)
        changed = stops or faster > _SPEED_STEP or turned > _TURN_STEP
        moving = wanted != (0.0, 0.0)
        if changed or (moving and site_time_s - self._drive_at >= self._keep_alive_s):
            self._drive, self._drive_at = wanted, site_time_s
            self._send(DriveCommand(seq=self._next(), speed_mps=wanted[0], turn_radps=wanted[1]))

    def _apply_tool(self, order: Order, site_time_s: float) -> None:
        if not order.joints:
            return
        changed = any(abs(self._joints.get(n, 99.0) - angle) > _JOINT_STEP for n, angle in order.joints.items())
        if changed or site_time_s - self._tool_at >= self._keep_alive_s:
            self._joints, self._tool_at = dict(order.joints), site_time_s
            self._send(ToolCommand(seq=self._next(), joints=order.joints))

    def _next(self) -> int:
        self._seq += 1
        return self._seq

    def _send(self, command: DriveCommand | ToolCommand) -> None:
        self._bus.publish(SIM_COMMAND, SimCommand(command), robot_id=self._robot_id)
