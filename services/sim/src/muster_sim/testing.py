"""Working a world by hand, for tests and benchmarks: the moves that an agent would make, without a bus."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from muster_schemas.sim import DriveCommand, ToolCommand
from muster_schemas.site import Site

from .world import STEP_S, World

READY: Final = {"boom": 0.97, "arm": -1.58}
"""Bucket well above a truck's bed, its middle 4.6 m ahead when it opens."""
DEEP: Final = {"boom": 0.38, "arm": -1.49}
"""Tip of the open bucket 5.0 m ahead and 0.3 m below the ground."""
OPEN, CLOSED = -0.4, -1.2
AHEAD_M: Final = 4.6
RESEND_S: Final = 0.25


TYPES: Final[Mapping[str, Mapping[str, Any]]] = {
    "excavator": {"body": "excavator", "length_m": 3.6, "width_m": 2.5, "max_speed_mps": 1.5, "capacity_m3": 0.5},
    "dump_truck": {"body": "dump_truck", "length_m": 3.6, "width_m": 2.2, "max_speed_mps": 2.5, "capacity_m3": 1.5},
    "carrier": {"length_m": 2.0, "width_m": 1.2, "max_speed_mps": 1.0},
}


def small_site(
    robots: Mapping[str, tuple[str, float, float, float]],
    things: Sequence[Mapping[str, Any]] = (),
    cameras: Sequence[Mapping[str, Any]] = (),
) -> Site:
    """Return a site of 60 m by 60 m around the origin.

    Args:
        robots: type ("excavator", "dump_truck", "carrier"), x, y and yaw of each, by id.
        things: as in a site's file.
        cameras: as in a site's file.

    """
    return Site.model_validate(
        {
            "name": "small",
            "bounds": {"min_x": -30, "min_y": -30, "max_x": 30, "max_y": 30},
            "robot_types": TYPES,
            "robots": [
                {"id": robot_id, "type": kind, "home": {"x": x, "y": y, "yaw": yaw}}
                for robot_id, (kind, x, y, yaw) in robots.items()
            ],
            "things": things,
            "cameras": cameras,
        }
    )


class Operator:
    """Gives the robots of a world commands, again and again as an agent would, while site time passes."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._drives: dict[str, DriveCommand] = {}
        self._tools: dict[str, ToolCommand] = {}
        self._seq = 0

    def drive(self, robot_id: str, speed_mps: float, turn_radps: float = 0.0) -> None:
        """Keep this speed and turning rate from now on."""
        self._drives[robot_id] = DriveCommand(seq=0, speed_mps=speed_mps, turn_radps=turn_radps)
        self.world.command(robot_id, self._drives[robot_id])

    def tool(self, robot_id: str, **joints: float) -> None:
        """Keep these joint targets from now on."""
        self._tools[robot_id] = ToolCommand(seq=0, joints=joints)
        self.world.command(robot_id, self._tools[robot_id])

    def let_go(self) -> None:
        """Command nothing any more."""
        self._drives.clear()
        self._tools.clear()

    def step(self) -> None:
        """Let one step pass."""
        if self.world.steps % round(RESEND_S / STEP_S) == 0:
            for commands in (self._drives, self._tools):
                for robot_id, command in commands.items():
                    self.world.command(robot_id, command)
        self.world.step()

    def wait(self, seconds: float) -> None:
        """Let site time pass."""
        for _ in range(round(seconds / STEP_S)):
            self.step()

    def until(self, condition: Callable[[], bool], limit_s: float = 60.0) -> None:
        """Let site time pass until something is so.

        Raises:
            TimeoutError: it is not so after `limit_s` of site time.

        """
        end = self.world.time_s + limit_s
        while not condition():
            if self.world.time_s > end:
                raise TimeoutError(f"not so after {limit_s} s of site time")
            self.step()

    def reach(self, robot_id: str, **joints: float) -> None:
        """Move joints and wait until they are there."""
        self.tool(robot_id, **joints)
        machine = self.world.machines[robot_id]
        self.until(lambda: all(abs(machine.joints[j] - angle) < 1e-6 for j, angle in joints.items()))

    def dig(self, robot_id: str, swing: float = 0.0) -> None:
        """Dig 5 m away in the direction `swing` and lift the bucket."""
        self.reach(robot_id, **READY, bucket=OPEN, swing=swing)
        self.reach(robot_id, **DEEP)
        self.reach(robot_id, bucket=CLOSED)
        self.reach(robot_id, **READY)

    def unload(self, robot_id: str, swing: float = 0.0) -> None:
        """Open the bucket `AHEAD_M` away in the direction `swing`."""
        self.reach(robot_id, swing=swing)
        self.reach(robot_id, bucket=OPEN)

    def drive_to(self, robot_id: str, x: float, y: float, within_m: float = 0.3) -> None:
        """Turn towards a place, drive there in a straight line and stop."""
        machine = self.world.machines[robot_id]

        def there() -> bool:
            ahead = math.atan2(y - machine.y, x - machine.x)
            error = math.remainder(ahead - machine.yaw, math.tau)
            far = math.hypot(x - machine.x, y - machine.y)
            self.drive(robot_id, min(machine.kind.max_speed_mps, far) if abs(error) < 0.3 else 0.0, 1.5 * error)
            return far < within_m

        self.until(there)
        self.drive(robot_id, 0.0)
        self.until(lambda: abs(machine.speed) < 1e-6)
