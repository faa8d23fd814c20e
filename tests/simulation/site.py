"""One run's whole site: its processes, its network, its operator, and the history of what happened."""

import asyncio
import contextlib
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from muster_bus import NoReplyError, RefusedError
from muster_scheduler.testing import as_seen, yard_file
from muster_schemas.channels import CONTROL, MISSION_STATE, MISSIONS, OBJECT, SKILL_REQUEST, SUBMIT, TASK_STATE, Channel
from muster_schemas.mission import MissionState, MissionStatus, TaskState
from muster_schemas.plan import Plan, PlanTask
from muster_schemas.robot import SkillRequest
from muster_schemas.rpc import ControlMission, ControlReply, MissionAction, MissionsQuery, MissionsReply, SubmitMission
from muster_schemas.site import Site, load_site
from pydantic import BaseModel

from .history import Answered, Heard, History, Published, Trouble
from .machines import Bodies, Body
from .network import Network, Noise, SimulatedBus
from .processes import AgentProcess, Process, SchedulerProcess
from .virtual import BEGIN

ROBOTS: Final = ("robot_excavator_01", "robot_excavator_02", "robot_dump_truck_01", "robot_dump_truck_02")
ENDS_WITHIN_S: Final = 400.0
"""So long after the last trouble every mission must have ended (invariant I7)."""
QUIET_WITHIN_S: Final = 60.0
"""So long after that nobody may owe anybody a word."""
_ASK_AGAIN_S: Final = 0.7


def small_site() -> Site:
    """Return the default site with fewer robots."""
    whole = load_site(yard_file())
    return whole.model_copy(update={"robots": tuple(r for r in whole.robots if r.id in ROBOTS)})


SITE: Final = small_site()


class Yard:
    """What a script acts on."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.rng = random.Random(f"network of {seed}")
        self.history = History()
        self.network = Network(self.rng, SITE.name)
        self.network.sent = self._on_sent
        self.network.delivered = self._on_delivered
        bodies = {r.id: Body(r.id, r.home, self.history, seed) for r in SITE.robots}
        self.bodies = Bodies(bodies)
        self.scheduler = SchedulerProcess(self.network, SITE, folder / "scheduler")
        self.agents = {r: AgentProcess(self.network, SITE, folder / r, b) for r, b in bodies.items()}
        self.processes: dict[str, Process] = {"scheduler": self.scheduler, **self.agents}
        self.operator = SimulatedBus(self.network, "operator", "boot-operator")
        self.vision = SimulatedBus(self.network, "vision", "boot-vision")
        self.missions: dict[int, str] = {}
        """The script's number of a mission -> its id, once the submission is answered."""
        self.wanted: set[int] = set()
        self.requests: list[SkillRequest] = []
        """All that the scheduler has sent."""
        self.ended: set[str] = set()
        self._work: list[asyncio.Task[None]] = []

    @property
    def now(self) -> float:
        """Virtual seconds."""
        return asyncio.get_running_loop().time()

    def trouble(self, what: str) -> None:
        """Note what the script does."""
        self.history.add(Trouble(self.now, what))

    def later(self, seconds: float, action: Callable[[], None]) -> None:
        """Do something after a while."""
        asyncio.get_running_loop().call_later(seconds, action)

    def open(self) -> None:
        """Start every process, and show the map."""
        for process in self.processes.values():
            self._work.append(asyncio.create_task(process.supervise(), name=f"supervise {process.name}"))
        for thing in SITE.things:
            self.show(thing.name)

    async def close(self) -> None:
        """End everything."""
        for process in self.processes.values():
            process.kill()
        while left := asyncio.all_tasks() - {asyncio.current_task()}:
            for task in left:
                task.cancel()
            await asyncio.gather(*left, return_exceptions=True)

    def show(self, name: str) -> None:
        """Put a thing on the map."""
        thing = next(t for t in SITE.things if t.name == name)
        self.vision.publish(OBJECT, as_seen(thing, BEGIN + self.now), object_name=name)

    def hide(self, name: str) -> None:
        """Take a thing off the map."""
        self.vision.retract(OBJECT, object_name=name)

    def quiet(self) -> None:
        """End all trouble."""
        self.trouble("all trouble ends")
        self.network.noise = Noise()
        for process in self.processes.values():
            process.disk_full = False
            process.places_left = None
        for bus in tuple(self.network.buses):
            self.network.heal(bus)
        for thing in SITE.things:
            self.show(thing.name)

    def operate(self, work: Any) -> None:
        """Let the operator do something beside all else."""
        self._work.append(asyncio.create_task(work))

    async def submit(self, number: int, tasks: tuple[PlanTask, ...], priority: int, *, ask: bool, later: bool) -> None:
        """Submit until it is answered, as a program with an idempotency key does; with `later` the plan comes after."""
        self.wanted.add(number)
        plan = Plan(tasks=tasks)
        request = SubmitMission(
            text=f"mission {number}",
            plan=None if later else plan,
            priority=priority,
            approval="ask" if ask else "auto",
            idempotency_key=f"key-{number}",
        )
        while number not in self.missions:
            with contextlib.suppress(NoReplyError, RefusedError):
                reply: ControlReply = await self.operator.ask(SUBMIT, request, timeout_s=5.0)
                self.missions[number] = reply.mission_id
                self.history.add(Answered(self.now, "submit", reply.mission_id))
                break
            await asyncio.sleep(_ASK_AGAIN_S)
        if later:
            await self.control(number, MissionAction.SET_PLAN, plan=plan, tries=1000)

    async def control(self, number: int, action: MissionAction, *, plan: Plan | None = None, tries: int = 10) -> None:
        """Ask for an action until it is answered with yes, or with no for good."""
        if number not in self.missions:
            return
        request = ControlMission(mission_id=self.missions[number], action=action, plan=plan)
        for _ in range(tries):
            try:
                reply: ControlReply = await self.operator.ask(CONTROL, request, timeout_s=3.0)
            except NoReplyError:
                await asyncio.sleep(_ASK_AGAIN_S)
            except RefusedError as error:
                if error.error.code == "conflict":
                    return
                await asyncio.sleep(_ASK_AGAIN_S)
            else:
                self.history.add(Answered(self.now, action, reply.mission_id, dict(reply.robots)))
                return

    async def states(self) -> dict[str, MissionState] | None:
        """Return the missions as the scheduler has them, or None if it does not answer."""
        try:
            reply: MissionsReply = await self.operator.ask(MISSIONS, MissionsQuery(limit=1000), timeout_s=3.0)
        except (NoReplyError, RefusedError):
            return None
        return {v.mission.mission_id: v.mission for v in reply.missions}

    async def finish(self) -> list[str]:
        """See every mission to its end; return those that do not come to one."""
        give_up = self.now + ENDS_WITHIN_S
        helping = {
            MissionStatus.AWAITING_APPROVAL: MissionAction.APPROVE,
            MissionStatus.PAUSED: MissionAction.RESUME,
        }
        open_missions = ["nothing was answered"]
        while self.now < give_up:
            await asyncio.sleep(1.0)
            states = await self.states()
            if states is None:
                continue
            numbers = {m: n for n, m in self.missions.items()}
            for mission in states.values():
                if mission.mission_id in numbers and mission.state in helping:
                    await self.control(numbers[mission.mission_id], helping[mission.state])
            open_missions = [f"mission {n} was never answered" for n in sorted(self.wanted - set(self.missions))]
            open_missions += [f"{m.mission_id} is {m.state}" for m in states.values() if not m.state.ended]
            if not open_missions:
                return []
        return open_missions

    def owed(self) -> list[str]:
        """Return who still does or repeats something although every mission has ended."""
        return [
            f"{b.robot_id} still works on {b.doing[0].request.ref}" for b in self.bodies.by_robot.values() if b.doing
        ]

    def _on_sent(self, bus: SimulatedBus, channel: Channel[Any], message: BaseModel) -> None:
        if channel in (MISSION_STATE, TASK_STATE) and isinstance(message, MissionState | TaskState):
            self.history.add(Published(self.now, message))
        elif channel is SKILL_REQUEST and isinstance(message, SkillRequest) and bus.name == "scheduler":
            self.requests.append(message)

    def _on_delivered(self, bus: SimulatedBus, channel: Channel[Any], message: BaseModel) -> None:
        if channel is SKILL_REQUEST and isinstance(message, SkillRequest) and bus.name in self.agents:
            self.history.add(Heard(self.now, bus.name, self.agents[bus.name].memory, message))
