"""Running one skill: stepping it by telemetry, pausing, cancelling into a safe halt, ending it at its timeout."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from muster_schemas.machines import EXCAVATOR
from muster_schemas.robot import SkillRequest, SkillStatusKind
from muster_schemas.sim import Telemetry

from muster_robot_agent.machine import Machine, Order, SkillFailedError, Steps

from .areas import obey_rules
from .digging import dig
from .drive import return_to_start, target_area
from .loading import take_on_load
from .motion import lower_bed, move_joints
from .tipping import tip
from .unloading import HOLD_RAD, unload

SkillSteps = Callable[[Machine, SkillRequest], Steps]

SKILLS: Final[Mapping[str, SkillSteps]] = {
    "avoid_areas_for_all_robots": obey_rules,
    "avoid_areas_for_specific_robots": obey_rules,
    "target_area_for_all_robots": target_area,
    "target_area_for_specific_robots": target_area,
    "allow_areas_for_all_robots": obey_rules,
    "allow_areas_for_specific_robots": obey_rules,
    "return_to_start_for_all_robots": return_to_start,
    "return_to_start_for_specific_robots": return_to_start,
    "excavator_digging": dig,
    "excavator_unloading": unload,
    "dump_loading": take_on_load,
    "dump_unloading": tip,
}

HALT_WAIT_S: Final = 15.0
"""Site time that a safe halt may take before the attempt ends all the same."""


@dataclass(frozen=True)
class Outcome:
    """How a skill ended."""

    state: SkillStatusKind
    reason: str | None = None


class SkillRun:
    """One attempt on one machine."""

    def __init__(self, machine: Machine, request: SkillRequest) -> None:
        self.request = request
        self.outcome: Outcome | None = None
        self.held = False
        """The machine stands still because of a pause."""
        self._machine = machine
        machine.note, machine.progress = None, 0.0
        self._steps = SKILLS[request.skill](machine, request)
        self._ends_at = machine.now + request.timeout_s
        self._cancelled = False
        self._paused = False
        self._waiting = False

    def step(self, telemetry: Telemetry, *, suspended: bool = False) -> Order:
        """Take in telemetry and return what the machine is to do; `outcome` is set once it has ended.

        Args:
            telemetry: the newest.
            suspended: the agent wants the machine to hold still for now, although nobody has paused the skill.

        """
        machine = self._machine
        waits = self._paused or suspended
        machine.sense(telemetry, working=not waits)
        if waits:
            if not self._waiting:
                machine.hold()
            self._waiting = True
            self.held = self._paused and machine.still
            if self._cancelled and machine.still:
                # whoever wants it to hold still does not want it to move into a better rest either
                self._steps.close()
                self.outcome = Outcome(SkillStatusKind.CANCELLED, "held as it stood")
            return machine.order()
        self._waiting = False
        try:
            if machine.now > self._ends_at:
                self._fall_back(Outcome(SkillStatusKind.FAILED, f"not done within {self.request.timeout_s:.0f} s"))
            next(self._steps)
        except StopIteration:
            self.outcome = self.outcome or self._ended()
        except SkillFailedError as failure:
            self.outcome = self._ended(failure)
        if self.outcome is not None:
            machine.hold()
            machine.path = ()
        return machine.order()

    @property
    def holds(self) -> bool:
        """Whether the last order was to hold every track and joint where it is."""
        return self._waiting

    def pause(self) -> None:
        """Hold still until `resume`."""
        self._paused = True

    def resume(self) -> None:
        """Go on where the pause came."""
        self._paused = self.held = False

    def cancel(self) -> None:
        """Come to a safe halt instead of going on."""
        self._cancelled = True
        self._paused = self.held = False
        self._fall_back(Outcome(SkillStatusKind.CANCELLED))

    def give_up(self, reason: str) -> None:
        """End at once as failed, because the machine itself is gone."""
        self._steps.close()
        self._machine.path = ()
        self.outcome = Outcome(SkillStatusKind.CANCELLED if self._cancelled else SkillStatusKind.FAILED, reason)

    def _fall_back(self, outcome: Outcome) -> None:
        self._steps.close()
        self._machine.path = ()
        self._ends_at = self._machine.now + HALT_WAIT_S + 1.0
        self._steps = _halted(self._machine, outcome)

    def _ended(self, failure: SkillFailedError | None = None) -> Outcome:
        """Say how it ended; a cancelled one stays cancelled even if the halt was not perfect."""
        if self._cancelled:
            return Outcome(SkillStatusKind.CANCELLED, str(failure) if failure else None)
        if failure is not None:
            return Outcome(SkillStatusKind.FAILED, str(failure))
        return Outcome(SkillStatusKind.SUCCEEDED, self._machine.note)


def _halted(machine: Machine, outcome: Outcome) -> Steps:
    """Stand still with nothing that could fall or tip: tracks stopped, a filled bucket held, the bed down."""
    machine.hold()
    joints = machine.telemetry.joints
    if machine.type.body == "excavator" and not machine.load.empty and joints["bucket"] > EXCAVATOR.holds_below_rad:
        yield from move_joints(machine, {"bucket": HOLD_RAD})
    yield from lower_bed(machine)
    deadline = machine.now + HALT_WAIT_S
    while not machine.still and machine.now < deadline:
        yield
    if outcome.state is SkillStatusKind.FAILED:
        raise SkillFailedError(outcome.reason or "")
