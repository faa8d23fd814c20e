"""Testing support: models written as functions, a scheduler's side of the bus, standing robots.

Nothing here stands in for code of the planner: they are real programs on the other side of its ports.
"""

import asyncio
import contextlib
import itertools
import json
from collections.abc import AsyncGenerator, Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

import httpx
from muster_bus import Bus, Refusal
from muster_bus.testing import SITE_FILE, RouterProcess, eventually, running_bus
from muster_schemas.base import Point
from muster_schemas.channels import (
    CONTROL,
    MISSION_STATE,
    MISSIONS,
    OBJECT,
    ROBOT_ALIVE,
    ROBOT_CARD,
    SERVICE_ALIVE,
    STOP,
    SUBMIT,
)
from muster_schemas.gate import check_plan
from muster_schemas.ids import new_id
from muster_schemas.mission import MissionState, MissionStatus, MissionView
from muster_schemas.plan import InstructionFunction, Plan, PlanTask
from muster_schemas.rpc import (
    ControlMission,
    ControlReply,
    ErrorCode,
    ErrorReply,
    MissionAction,
    MissionsQuery,
    MissionsReply,
    SubmitMission,
)
from muster_schemas.site import load_site
from muster_schemas.stops import StopReply, StopRobots
from muster_schemas.world import MapObject

from .llm import PlanDraft, PlanRequest
from .service import bind, serve_model
from .settings import PlannerSettings

YARD = load_site(SITE_FILE)

_sites = itertools.count(1)
"""So that planners on one router do not hear each other."""

Answer = Plan | str
"""A plan, or why it is refused."""


def one_task(skill: str, robot: str, *objects: str, name: str = "only") -> Plan:
    """Return a plan of one task."""
    function = InstructionFunction(name=skill, robot_ids=(robot,), object_keywords=objects)
    return Plan(tasks=(PlanTask(task=name, instruction_function=function),))


DRIVE = one_task("target_area_for_specific_robots", "robot_excavator_01", "soil1")
"""A plan that runs on the default site."""

NOWHERE = one_task("target_area_for_specific_robots", "robot_excavator_01", "puddle7")
"""A plan for an object that the default site lacks."""


class FunctionModel:
    """A planning model that is a function of the request; it remembers what it was asked."""

    def __init__(self, answer: Callable[[PlanRequest], Answer | Awaitable[Answer]]) -> None:
        self._answer = answer
        self.requests: list[PlanRequest] = []
        self.at_once = 0
        self.most_at_once = 0

    async def plan(self, request: PlanRequest) -> PlanDraft:
        """Return what the function says."""
        self.requests.append(request)
        self.at_once += 1
        self.most_at_once = max(self.most_at_once, self.at_once)
        try:
            given = self._answer(request)
            answer = given if isinstance(given, (Plan, str)) else await given
        finally:
            self.at_once -= 1
        plan, refusal = (None, answer) if isinstance(answer, str) else (answer, None)
        raw = answer if isinstance(answer, str) else answer.model_dump_json()
        return PlanDraft(plan=plan, refusal=refusal, raw=raw, latency_s=0.0, tokens_in=10, tokens_out=10)


class Missions:
    """The scheduler's side of the bus with missions that are planned and approved but never run."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self.views: dict[str, MissionView] = {}
        self._keys: dict[str, str] = {}
        self.answers_after_s = 0.0
        """How long it keeps an answer back, after it has done what was asked."""

    async def submit(self, request: SubmitMission) -> ControlReply:
        """Make a mission, once per idempotency key."""
        key = request.idempotency_key or new_id("key")
        if key not in self._keys:
            self._keys[key] = new_id("m")
            self.put(self._keys[key], request.text, priority=request.priority, approval=request.approval)
        return await self._reply(self._keys[key])

    async def control(self, request: ControlMission) -> ControlReply:
        """Do what may be done in the mission's state."""
        view = self.views.get(request.mission_id)
        if view is None:
            raise Refusal.because(ErrorCode.NOT_FOUND, f"There is no mission {request.mission_id}.")
        allowed = {
            MissionAction.SET_PLAN: (MissionStatus.PLANNING, MissionStatus.AWAITING_APPROVAL),
            MissionAction.REFUSE: (MissionStatus.PLANNING,),
            MissionAction.APPROVE: (MissionStatus.AWAITING_APPROVAL,),
            MissionAction.REJECT: (MissionStatus.AWAITING_APPROVAL,),
            MissionAction.PAUSE: (MissionStatus.RUNNING,),
            MissionAction.RESUME: (MissionStatus.PAUSED,),
            MissionAction.CANCEL: tuple(s for s in MissionStatus if not s.ended),
        }.get(request.action, ())
        if view.mission.state not in allowed:
            raise Refusal.because(ErrorCode.CONFLICT, f"The mission is {view.mission.state}.")
        if request.plan_revision not in (None, view.mission.plan_revision):
            raise Refusal.because(ErrorCode.CONFLICT, "The plan has changed meanwhile.")
        if request.plan is not None:
            self._check(request.plan)
        after = {
            MissionAction.SET_PLAN: MissionStatus.RUNNING
            if view.mission.approval == "auto"
            else MissionStatus.AWAITING_APPROVAL,
            MissionAction.REFUSE: MissionStatus.REJECTED,
            MissionAction.APPROVE: MissionStatus.RUNNING,
            MissionAction.REJECT: MissionStatus.REJECTED,
            MissionAction.PAUSE: MissionStatus.PAUSED,
            MissionAction.RESUME: MissionStatus.RUNNING,
            MissionAction.CANCEL: MissionStatus.CANCELLED,
        }[request.action]
        mission = view.mission.model_copy(
            update={
                "state": after,
                "revision": view.mission.revision + 1,
                "plan_revision": view.mission.plan_revision + (request.plan is not None),
                "reasons": request.reasons,
            }
        )
        self._publish(MissionView(mission=mission, plan=request.plan or view.plan))
        return await self._reply(request.mission_id)

    async def stop(self, request: StopRobots) -> StopReply:
        """Have every robot that is meant obey at once."""
        known = [request.robot_id] if request.robot_id else [r.id for r in YARD.robots]
        if not {r.id for r in YARD.robots} >= set(known):
            raise Refusal.because(ErrorCode.NOT_FOUND, f"There is no robot {request.robot_id}.")
        word = "was idle" if request.stop else "released"
        return StopReply(site_stopped=request.stop and request.robot_id is None, robots=dict.fromkeys(known, word))

    async def read(self, query: MissionsQuery) -> MissionsReply:
        """Return missions, newest first."""
        found = [
            v
            for v in reversed(self.views.values())
            if query.mission_id in (None, v.mission.mission_id)
            and (not query.states or v.mission.state in query.states)
        ]
        if query.mission_id is not None and not found:
            raise Refusal.because(ErrorCode.NOT_FOUND, f"There is no mission {query.mission_id}.")
        return MissionsReply(missions=tuple(found[: query.limit]))

    def put(self, mission_id: str, text: str, **fields: Any) -> None:
        """Have a mission in `planning`."""
        mission = MissionState(
            mission_id=mission_id, revision=1, text=text, state=MissionStatus.PLANNING, created_at=1.0, **fields
        )
        self._publish(MissionView(mission=mission))

    def state(self, mission_id: str) -> MissionStatus:
        """Return where a mission stands."""
        return self.views[mission_id].mission.state

    def _check(self, plan: Plan) -> None:
        roster = [YARD.card(r.id, "boot-1") for r in YARD.robots]
        # soil2 is what only this side knows to be gone, so that its gate may differ from the planner's
        objects = {t.name for t in YARD.things} - {"soil2"}
        reasons = check_plan(plan, roster, objects, YARD.catalogue)
        if reasons:
            raise Refusal(ErrorReply(code=ErrorCode.INVALID, message="The gate refuses it.", reasons=tuple(reasons)))

    def _publish(self, view: MissionView) -> None:
        self.views[view.mission.mission_id] = view
        self._bus.publish(MISSION_STATE, view.mission, mission_id=view.mission.mission_id)

    async def _reply(self, mission_id: str) -> ControlReply:
        await asyncio.sleep(self.answers_after_s)
        return ControlReply(mission_id=mission_id, state=self.state(mission_id))


@contextlib.asynccontextmanager
async def missions_side(bus: Bus) -> AsyncGenerator[Missions]:
    """Serve the scheduler's side of the bus while entered."""
    missions = Missions(bus)
    async with (
        bus.serve(SUBMIT, missions.submit),
        bus.serve(CONTROL, missions.control),
        bus.serve(MISSIONS, missions.read),
        bus.serve(STOP, missions.stop),
        bus.alive(SERVICE_ALIVE, service="scheduler", boot_id="boot-1"),
    ):
        yield missions


@contextlib.asynccontextmanager
async def standing_robots(bus: Bus, robots: Sequence[str] | None = None) -> AsyncGenerator[None]:
    """Announce robots of the default site (all of them if none are given) while entered."""
    async with contextlib.AsyncExitStack() as stack:
        for robot_id in robots if robots is not None else [r.id for r in YARD.robots]:
            bus.publish(ROBOT_CARD, YARD.card(robot_id, "boot-1"), robot_id=robot_id)
            await stack.enter_async_context(bus.alive(ROBOT_ALIVE, robot_id=robot_id, boot_id="boot-1"))
        yield


def show_objects(bus: Bus, *names: str) -> None:
    """Put objects on the map; all things of the default site if none are named."""
    places = {t.name: t.position for t in YARD.things}
    for name in names or places:
        seen = MapObject.model_validate(
            {
                "name": name,
                "class": name.rstrip("0123456789"),
                "position": places.get(name, Point(x=0, y=0)),
                "size": {"length_m": 2, "width_m": 1},
                "confidence": 0.9,
                "seen_at": 1.0,
            }
        )
        bus.publish(OBJECT, seen, object_name=name)


class Planner:
    """A planner that runs in the test's own process, and an HTTP client for it."""

    def __init__(self, http: httpx.AsyncClient, missions: Missions, bus: Bus) -> None:
        self.http = http
        self.missions = missions
        self.bus = bus
        """Of the scheduler's side, the robots and the cameras."""

    async def send(self, text: str, **fields: Any) -> str:
        """Send an instruction and return its mission's id."""
        answer = await self.http.post("/instructions", json={"text": text, **fields})
        assert answer.status_code == 202, answer.text  # noqa: S101 (testing support)
        return answer.json()["mission_id"]

    async def until(self, mission_id: str, state: MissionStatus) -> MissionView:
        """Wait until the mission is in that state."""
        await eventually(lambda: self.missions.state(mission_id) is state)
        return self.missions.views[mission_id]


@contextlib.asynccontextmanager
async def running_planner(
    router: RouterProcess, model: FunctionModel, *, objects: Sequence[str] = (), **settings: Any
) -> AsyncGenerator[Planner]:
    """Run a planner over a real bus and real HTTP, with all robots and things of the default site there."""
    read = PlannerSettings(site_file=SITE_FILE, connect=(router.endpoint,), port=0, **settings)
    listening, stop = bind(read), asyncio.Event()
    address = f"http://127.0.0.1:{listening.getsockname()[1]}"
    site = f"yard-{next(_sites)}"
    async with contextlib.AsyncExitStack() as stack:
        others = await stack.enter_async_context(running_bus(router, site))
        missions = await stack.enter_async_context(missions_side(others))
        await stack.enter_async_context(standing_robots(others))
        show_objects(others, *objects)
        own = await stack.enter_async_context(running_bus(router, site))
        serving = asyncio.create_task(serve_model(own, stop, read, listening, model))
        stack.push_async_callback(_ended, serving, stop)
        headers = {"Authorization": f"Bearer {read.token.get_secret_value()}"} if read.token else {}
        http = await stack.enter_async_context(httpx.AsyncClient(base_url=address, headers=headers, timeout=120))

        async def ready() -> bool:
            fleet, objects_seen = await http.get("/fleet"), await http.get("/objects")
            robots = fleet.json()["robots"]
            seen = {o["name"] for o in objects_seen.json()["objects"]}
            return (
                (await http.get("/readyz")).status_code == 200
                and len(robots) == len(YARD.robots)
                and all(r["online"] for r in robots)
                and seen >= set(objects or [t.name for t in YARD.things])
            )

        await eventually(ready)
        yield Planner(http, missions, others)


async def _ended(serving: "asyncio.Task[None]", stop: asyncio.Event) -> None:
    stop.set()
    await serving


def lines_of(path: Path) -> list[dict[str, Any]]:
    """Return the objects of a file of JSON lines."""
    return [json.loads(line) for line in path.read_text().splitlines()]
