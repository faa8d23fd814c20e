"""The site's file (`sites/*.yaml`): the one place that says what is on a site."""

from pathlib import Path
from typing import Annotated, Literal, Self

import yaml
from pydantic import Field, ValidationError, model_validator

from .base import Message, Metres, Point, Pose, Seconds
from .ids import Id
from .policies import ApprovalRule, AskForSkill, FailurePolicies
from .robot import RobotCard
from .skills import PAPER_SKILLS, Catalogue, Skill


class SiteError(ValueError):
    """The site's file cannot be used; the message says where and why."""


class Bounds(Message):
    """The rectangle that robots may drive in."""

    min_x: Metres
    min_y: Metres
    max_x: Metres
    max_y: Metres

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if self.min_x >= self.max_x or self.min_y >= self.max_y:
            raise ValueError("bounds must have min below max in x and y")
        return self


class RobotType(Message):
    """What all robots of a type share."""

    body: Literal["excavator", "dump_truck", "carrier"] = Field(
        default="carrier", description="how it is simulated; a carrier only drives"
    )
    letter: Annotated[str, Field(pattern="^[A-Z]$")] | None = Field(
        default=None, description="short name in the planner's prompt, such as E of E1; chosen if left out"
    )
    length_m: float = Field(gt=0, le=100)
    width_m: float = Field(gt=0, le=100)
    max_speed_mps: float = Field(gt=0, le=50)
    max_turn_radps: float = Field(default=0.6, gt=0, le=10)
    reach_m: float = Field(default=0.0, ge=0)
    capacity_m3: float = Field(default=0.0, ge=0)
    skills: tuple[Id, ...] = Field(
        default=(), description="beside the ones that every robot has; empty: by the catalogue"
    )


class RobotEntry(Message):
    """One robot; where it stands when the site starts is its home."""

    id: Id
    type: Id
    home: Pose


class Thing(Message):
    """Something on the ground that the simulator puts there. The other services see it only through the cameras."""

    name: Id
    object_class: str = Field(alias="class", max_length=64)
    position: Point
    radius_m: float = Field(gt=0, le=100)
    height_m: float = Field(default=0.0, ge=0, le=50)
    soil_m3: float = Field(default=0.0, ge=0, description="of a soil pile")


class Camera(Message):
    """A UAV camera of the simulator that looks straight down (tilt 0) or tilted to where `look_at` is."""

    id: Id
    position: Point
    height_m: float = Field(gt=0, le=500)
    look_at: Point | None = None
    field_of_view_deg: float = Field(default=60, gt=1, lt=170, description="vertical")
    width_px: int = Field(default=320, ge=16, le=4096)
    height_px: int = Field(default=320, ge=16, le=4096)
    rate_hz: float = Field(default=1.0, gt=0, le=30)


class VisionSettings(Message):
    """What the site's map always holds: class names, and the words that the detector is asked about each."""

    classes: dict[Id, str] = Field(description="class: prompt, such as 'puddle': 'a puddle of water'")
    flat: tuple[Id, ...] = Field(
        default=("puddle",), description="classes that lie flat: they have no sides to see, and things may lie on them"
    )
    loose: tuple[Id, ...] = Field(
        default=("soil",), description="classes of loose material: what is tipped elsewhere is a new heap"
    )


class Site(Message):
    """A site's whole file."""

    name: Id
    bounds: Bounds
    robot_types: dict[Id, RobotType]
    robots: Annotated[tuple[RobotEntry, ...], Field(min_length=1)]
    skills: tuple[Skill, ...] = Field(default=(), description="skills of new robot types, beside the paper's")
    things: tuple[Thing, ...] = ()
    cameras: tuple[Camera, ...] = ()
    vision: VisionSettings = VisionSettings(classes={})
    command_timeout_s: Seconds = Field(default=1.0, description="site time without a command after which machines halt")
    failures: FailurePolicies = Field(default=FailurePolicies(), description="what is done when a task fails")
    approval: tuple[ApprovalRule, ...] = Field(default=(), description="which plans wait for a person in any case")
    seed: int = 1

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for kind, names in (
            ("robot", [r.id for r in self.robots]),
            ("thing", [t.name for t in self.things]),
            ("camera", [c.id for c in self.cameras]),
        ):
            if len(set(names)) != len(names):
                raise ValueError(f"two {kind}s have the same name")
        for robot in self.robots:
            if robot.type not in self.robot_types:
                raise ValueError(f"robot {robot.id} has the type {robot.type}, which robot_types lacks")
        catalogue = self.catalogue
        for name, robot_type in self.robot_types.items():
            for skill in robot_type.skills:
                if skill not in catalogue:
                    raise ValueError(f"robot type {name} names the skill {skill}, which is in no catalogue")
        for skill in (*self.failures.skills, *(r.skill for r in self.approval if isinstance(r, AskForSkill))):
            if skill not in catalogue:
                raise ValueError(f"a policy names the skill {skill}, which is in no catalogue")
        return self

    @property
    def catalogue(self) -> Catalogue:
        """The paper's skills and the site's own."""
        return Catalogue.with_site(self.skills)

    def skills_of(self, robot_type: str) -> tuple[str, ...]:
        """Return the names of the skills that robots of this type have."""
        own = {self.catalogue.canonical(s) for s in self.robot_types[robot_type].skills}
        everyone = {s.name for s in PAPER_SKILLS if not s.robot_types}
        return tuple(s.name for s in self.catalogue if s.name in own | everyone or robot_type in s.robot_types)

    def card(self, robot_id: str, boot_id: str) -> RobotCard:
        """Return the card of one robot for this life of its agent.

        Raises:
            SiteError: the site has no such robot.

        """
        for robot in self.robots:
            if robot.id == robot_id:
                kind = self.robot_types[robot.type]
                return RobotCard(
                    robot_id=robot_id,
                    boot_id=boot_id,
                    type=robot.type,
                    skills=self.skills_of(robot.type),
                    home=robot.home,
                    length_m=kind.length_m,
                    width_m=kind.width_m,
                    max_speed_mps=kind.max_speed_mps,
                    reach_m=kind.reach_m,
                    capacity_m3=kind.capacity_m3,
                )
        known = ", ".join(r.id for r in self.robots)
        raise SiteError(f"site {self.name} has no robot {robot_id!r}; it has {known}")


def load_site(path: Path) -> Site:
    """Read and check a site's file.

    Raises:
        SiteError: it is missing, is no YAML, or breaks a rule of `Site`.

    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SiteError(f"cannot read the site file {path}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise SiteError(f"{path} is no YAML: {error}") from error
    try:
        return Site.model_validate(data)
    except ValidationError as error:
        problems = "; ".join(f"{'.'.join(map(str, e['loc'])) or 'file'}: {e['msg']}" for e in error.errors())
        raise SiteError(f"{path}: {problems}") from error
