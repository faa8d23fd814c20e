"""One valid message for each channel: what makers of other robots start from, and what tests of every package send."""

from dataclasses import dataclass, field
from typing import Final

from pydantic import BaseModel

from . import channels
from .base import Point, Pose
from .mission import MissionState, MissionStatus, MissionView, TaskState, TaskStatus
from .plan import Plan
from .robot import (
    Load,
    RobotCard,
    RobotState,
    SkillRequest,
    SkillStatus,
    SkillStatusKind,
    StatusAck,
    TargetObject,
    TaskRef,
)
from .rpc import (
    ControlMission,
    ControlReply,
    MissionAction,
    MissionsQuery,
    MissionsReply,
    ReplanMission,
    ReplanReply,
    RulesQuery,
    SubmitMission,
)
from .sim import DriveCommand, SimBody, SimCommand, SimWorld, SoilDeposit, Telemetry
from .stops import StopReply, StopRequest, StopRobots, StopStatus
from .world import AreaRule, AreaRules, CameraFrame, Keywords, MapObject

_MISSION, _TASK, _ROBOT, _BOOT = "m-1", "t1", "robot_excavator_01", "boot-1"
_AT = 1_700_000_000.0
_TEXT = "Excavator 1, dig at soil pile 1."
_ROBOT_IDS = {"robot_id": _ROBOT}
_SKILL_IDS = {"robot_id": _ROBOT, "skill": "excavator_digging"}


@dataclass(frozen=True)
class Example:
    """A message, the ids in its key (without the site), and the reply if its channel is a query."""

    message: BaseModel
    ids: dict[str, str] = field(default_factory=dict[str, str])
    reply: BaseModel | None = None


PLAN: Final = Plan.model_validate(
    {
        "tasks": [
            {
                "task": "go_to_soil_1",
                "instruction_function": {
                    "name": "target_area_for_specific_robots",
                    "robot_ids": [_ROBOT],
                    "object_keywords": ["soil1"],
                },
            },
            {
                "task": "dig_soil_1",
                "instruction_function": {
                    "name": "Excavation",
                    "robot_ids": [_ROBOT],
                    "dependencies": ["go_to_soil_1"],
                    "object_keywords": ["soil1"],
                },
            },
        ]
    }
)

_MISSION_STATE = MissionState(
    mission_id=_MISSION, revision=3, text=_TEXT, state=MissionStatus.RUNNING, created_at=_AT, started_at=_AT + 1
)
_TASK_STATE = TaskState(
    mission_id=_MISSION,
    task_id=_TASK,
    revision=7,
    name="dig_soil_1",
    skill="excavator_digging",
    state=TaskStatus.WAITING,
    robots=(_ROBOT,),
    objects=("soil1",),
    waiting_for=("object: soil1",),
)
_SOIL = MapObject.model_validate(
    {
        "name": "soil1",
        "class": "soil",
        "position": {"x": -10, "y": 12},
        "size": {"length_m": 4.8, "width_m": 4.6},
        "confidence": 0.9,
        "seen_at": _AT,
    }
)
_RULES = AreaRules(
    revision=2, rules=(AreaRule(robot_id=_ROBOT, object_name="puddle1", centre=Point(x=-9, y=-12), radius_m=3.2),)
)
_CONTROL_REPLY = ControlReply(mission_id=_MISSION, state=MissionStatus.RUNNING, robots={_ROBOT: "stopped"})
_POSE = Pose(x=-28, y=14, yaw=0.5)

EXAMPLES: Final[dict[str, Example]] = {
    channels.MISSION_STATE.name: Example(_MISSION_STATE, {"mission_id": _MISSION}),
    channels.TASK_STATE.name: Example(_TASK_STATE, {"mission_id": _MISSION, "task_id": _TASK}),
    channels.SKILL_REQUEST.name: Example(
        SkillRequest(
            mission_id=_MISSION,
            task_id=_TASK,
            attempt=1,
            epoch=4,
            robot_id=_ROBOT,
            boot_id=_BOOT,
            skill="excavator_digging",
            issued_at=_AT,
            deadline=_AT + 30,
            objects=(TargetObject(name="soil1", object_class="soil", position=_SOIL.position, radius_m=2.4),),
            goals=(Pose(x=-14, y=12),),
        ),
        _SKILL_IDS,
    ),
    channels.SKILL_STATUS.name: Example(
        SkillStatus(
            mission_id=_MISSION,
            task_id=_TASK,
            attempt=1,
            epoch=4,
            robot_id=_ROBOT,
            boot_id=_BOOT,
            skill="excavator_digging",
            seq=2,
            state=SkillStatusKind.SUCCEEDED,
            progress=1.0,
            at=_AT,
        ),
        _SKILL_IDS,
    ),
    channels.STATUS_ACK.name: Example(
        StatusAck(mission_id=_MISSION, task_id=_TASK, attempt=1, robot_id=_ROBOT, boot_id=_BOOT, seq=2, epoch=4),
        _SKILL_IDS,
    ),
    channels.ROBOT_STOP.name: Example(
        StopRequest(robot_id=_ROBOT, number=1_700_000_000_000, stopped=True, issued_at=_AT), _ROBOT_IDS
    ),
    channels.ROBOT_STOP_STATUS.name: Example(
        StopStatus(
            robot_id=_ROBOT,
            boot_id=_BOOT,
            number=1_700_000_000_000,
            stopped=True,
            standing=True,
            was_busy=True,
            busy_with=TaskRef(mission_id=_MISSION, task_id=_TASK, attempt=1),
            at=_AT,
        ),
        _ROBOT_IDS,
    ),
    channels.ROBOT_CARD.name: Example(
        RobotCard(
            robot_id=_ROBOT,
            boot_id=_BOOT,
            type="excavator",
            skills=("excavator_digging",),
            home=_POSE,
            length_m=3.6,
            width_m=2.5,
            max_speed_mps=1.5,
            reach_m=7.5,
            capacity_m3=0.5,
        ),
        _ROBOT_IDS,
    ),
    channels.ROBOT_STATE.name: Example(
        RobotState(
            robot_id=_ROBOT,
            boot_id=_BOOT,
            seq=12,
            pose=_POSE,
            load=Load(soil_m3=0.4),
            busy_with=TaskRef(mission_id=_MISSION, task_id=_TASK, attempt=1),
            at=_AT,
        ),
        _ROBOT_IDS,
    ),
    channels.OBJECT.name: Example(_SOIL, {"object_name": "soil1"}),
    channels.KEYWORDS.name: Example(Keywords(keywords=("puddle3",), asked_by="planner")),
    channels.AREAS.name: Example(_RULES),
    channels.CAMERA_IMAGE.name: Example(
        CameraFrame(
            camera_id="uav_sw",
            seq=1,
            taken_at=_AT,
            width_px=320,
            height_px=320,
            fx_px=277,
            fy_px=277,
            cx_px=160,
            cy_px=160,
            x_m=-17,
            y_m=-12,
            z_m=30,
            orientation=(1.0, 0.0, 0.0, 0.0),
        ),
        {"camera_id": "uav_sw"},
    ),
    channels.SIM_COMMAND.name: Example(
        SimCommand(DriveCommand(seq=5, speed_mps=1.2, turn_radps=0.1)),
        _ROBOT_IDS,
    ),
    channels.SIM_TELEMETRY.name: Example(
        Telemetry(
            robot_id=_ROBOT,
            seq=5,
            site_time_s=12.5,
            pose=_POSE,
            speed_mps=1.1,
            turn_radps=0.1,
            joints={"swing": 0.0, "boom": 0.3},
            load=Load(),
        ),
        _ROBOT_IDS,
    ),
    channels.SIM_WORLD.name: Example(
        SimWorld(
            site_time_s=12.5,
            speed_factor=10,
            achieved_factor=9.9,
            robots={_ROBOT: SimBody(pose=_POSE)},
            things={"rock1": SimBody(pose=Pose(x=7, y=-2), radius_m=0.8)},
            soil=(SoilDeposit(position=_SOIL.position, soil_m3=12, pile="soil1"),),
            robot_contacts=0,
        )
    ),
    channels.SUBMIT.name: Example(SubmitMission(text=_TEXT, plan=PLAN, idempotency_key="key 1"), reply=_CONTROL_REPLY),
    channels.CONTROL.name: Example(
        ControlMission(mission_id=_MISSION, action=MissionAction.SET_PLAN, plan=PLAN), reply=_CONTROL_REPLY
    ),
    channels.MISSIONS.name: Example(
        MissionsQuery(states=(MissionStatus.PLANNING,)),
        reply=MissionsReply(missions=(MissionView(mission=_MISSION_STATE, plan=PLAN, tasks=(_TASK_STATE,)),)),
    ),
    channels.STOP.name: Example(
        StopRobots(robot_id=_ROBOT), reply=StopReply(site_stopped=False, robots={_ROBOT: "stopped"})
    ),
    channels.RULES.name: Example(RulesQuery(), reply=_RULES),
    channels.REPLAN.name: Example(
        ReplanMission(
            mission_id=_MISSION,
            task_id=_TASK,
            number=1,
            text=_TEXT,
            done=PLAN.tasks[:1],
            failed=PLAN.tasks[1],
            error="robot_excavator_01: there is nothing to dig here",
        ),
        reply=ReplanReply(plan=PLAN),
    ),
}
"""By channel name; liveliness tokens have no message."""
