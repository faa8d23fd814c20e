"""Who a plan means: robots by id, and by type where a plan leaves the choice open."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from muster_schemas.plan import InstructionFunction
from muster_schemas.robot import RobotCard


@dataclass(frozen=True)
class Fleet:
    """The robots of the site on which a data set's instructions were given."""

    by_type: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, roster: Iterable[RobotCard]) -> "Fleet":
        """Return the fleet of a roster."""
        cards = sorted(roster, key=lambda c: c.robot_id)
        return cls({t: tuple(c.robot_id for c in cards if c.type == t) for t in sorted({c.type for c in cards})})

    @property
    def everyone(self) -> tuple[str, ...]:
        """Return all robots."""
        return tuple(robot for robots in self.by_type.values() for robot in robots)

    def of_type(self, robot_type: str, count: int | Literal["all"]) -> tuple[str, ...]:
        """Return all robots of a type, or as many without a name (`dump_truck?0`), which are the same in all tasks."""
        if count == "all":
            return self.by_type.get(robot_type, (f"{robot_type}?all",))
        return tuple(f"{robot_type}?{n}" for n in range(count))

    def meant_by(self, function: InstructionFunction) -> tuple[str, ...]:
        """Return the robots of a task; naming none means everyone."""
        if function.robot_ids:
            return function.robot_ids
        types: Sequence[str] = function.robot_type or tuple(self.by_type)
        count = function.robot_count or "all"
        return tuple(robot for t in types for robot in self.of_type(t, count)) or self.everyone


def type_of(robot: str) -> str | None:
    """Return the type of a robot without a name; None if it has one."""
    robot_type, mark, _ = robot.partition("?")
    return robot_type if mark else None
