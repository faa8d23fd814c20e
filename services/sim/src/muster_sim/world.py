"""A site in motion: what robots are told, what then happens, what the cameras see. No bus, no clock of its own.

Machines move kinematically (speeds and joints with limits) and stop where pybullet's collision shapes meet; soil is
counted, not simulated grain by grain. So a run depends on nothing but the site, its seed and the commands, and is
far faster than rigid body dynamics of tracked vehicles would be (docs/adr has the reasons).
"""

import math
from collections.abc import Mapping
from typing import Final, Self

import numpy as np
from muster_schemas.sim import DriveCommand, SimBody, SimWorld, Telemetry, ToolCommand
from muster_schemas.site import Camera, RobotEntry, RobotType, Site, SiteError

from .appearance import Appearance
from .bodies import SOIL_CLASS, Body, form_of
from .camera import pinhole, shaded
from .contacts import Contacts, Solid
from .loading import Loading
from .machines.base import CommandError, Machine
from .machines.carrier import Carrier
from .machines.dump_truck import DumpTruck
from .machines.excavator import Excavator
from .scene import Scene
from .snapshot import BodyState, Snapshot, digest
from .soil import Ground
from .textures import Picture

STEP_S: Final = 1 / 60
"""Site time of a step; three make a telemetry period."""
EDGE_M: Final = 20.0
"""How far beyond the site's bounds machines can get."""
SUN: Final = np.array([0.42, 0.5, 0.76])

_MACHINES: Final[Mapping[str, type[Excavator] | type[DumpTruck] | type[Carrier]]] = {
    "excavator": Excavator,
    "dump_truck": DumpTruck,
    "carrier": Carrier,
}


class World:
    """Everything on a site. Free it with `close` or use it with `with`.

    Args:
        site: the site's file.
        seed: of everything that is left to chance (looks); the site's own if left out.

    Raises:
        SiteError: a robot and a thing have the same name.

    """

    def __init__(self, site: Site, seed: int | None = None) -> None:
        if shared := {t.name for t in site.things} & {r.id for r in site.robots}:
            raise SiteError(f"site {site.name}: {', '.join(sorted(shared))} is both a robot and a thing")
        self.site = site
        self.seed = site.seed if seed is None else seed
        self.steps = 0
        self.load_changes = 0
        """How often soil or a thing has changed its place."""
        self.ground = Ground()
        self.bodies: dict[str, Body] = {}
        self._scene = Scene()
        self._looks = Appearance(self._scene, site.bounds, self.seed)
        rng = np.random.default_rng([self.seed, 11])
        for thing in site.things:
            at = thing.position
            if thing.object_class == SOIL_CLASS:
                self.ground.add_pile(thing.name, at, thing.radius_m, thing.height_m, thing.soil_m3)
            else:
                yaw = float(rng.uniform(-math.pi, math.pi))
                form, height = form_of(thing), thing.height_m or thing.radius_m
                self.bodies[thing.name] = Body(thing.name, form, thing.radius_m, height, at.x, at.y, yaw)
        self._body_handles = {b.name: self._looks.add_body(b) for b in self.bodies.values()}
        self.machines = {r.id: self._machine(r, site.robot_types[r.type]) for r in site.robots}
        machines = list(self.machines.values())
        self._handles = {m.id: self._scene.add_machine(m.base, m.links, m.hull) for m in machines}
        self._contacts = Contacts(self._scene, machines, list(self._handles.values()))
        self._loading = Loading(self.ground, self.bodies, machines)
        self._settle_ground()
        self._contacts.update()

    def close(self) -> None:
        """Free the renderer's and collision checker's memory."""
        self._scene.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def time_s(self) -> float:
        """Site time since the start."""
        return self.steps * STEP_S

    def command(self, robot_id: str, command: DriveCommand | ToolCommand) -> None:
        """Tell a robot what to do; it holds for the site's `command_timeout_s`.

        Raises:
            CommandError: no such robot, or it cannot do that; nothing was changed.

        """
        machine = self.machines.get(robot_id)
        if machine is None:
            raise CommandError(
                f"site {self.site.name} has no robot {robot_id[:64]!r}; it has {', '.join(self.machines)}"
            )
        if isinstance(command, DriveCommand):
            machine.drive(command, self.time_s)
        else:
            machine.move_tool(command, self.time_s)

    def step(self) -> None:
        """Let `STEP_S` of site time pass."""
        self.steps += 1
        changed = False
        for machine in self.machines.values():
            if machine.advance_joints(self.time_s, STEP_S):
                changed |= self._loading.after_joints(machine)
        if changed:
            self.load_changes += 1
            self._settle_ground()
        for machine in self.machines.values():
            target = machine.next_pose(self.time_s, STEP_S)
            if target is None:
                continue
            if self._leaves(machine, target):
                machine.stop()
            else:
                self._contacts.move(machine, target)
        self._contacts.update()

    def telemetry(self, robot_id: str, seq: int) -> Telemetry:
        """Return what a robot's own sensors say."""
        machine = self.machines[robot_id]
        return Telemetry(
            robot_id=robot_id,
            seq=seq,
            site_time_s=self.time_s,
            pose=machine.pose,
            speed_mps=machine.speed,
            turn_radps=machine.turn,
            joints=dict(machine.joints),
            load=machine.cargo.message(),
            touching=self._contacts.touching(robot_id),
        )

    def truth(self, speed_factor: float = 1.0, achieved_factor: float = 1.0) -> SimWorld:
        """Return everything as it is; the factors are those of the loop that steps this world."""
        return SimWorld(
            site_time_s=self.time_s,
            speed_factor=speed_factor,
            achieved_factor=achieved_factor,
            robots={
                m.id: SimBody(pose=m.pose, radius_m=m.radius_m, load=m.cargo.message()) for m in self.machines.values()
            },
            things={
                b.name: SimBody(pose=b.pose, radius_m=b.radius_m) for b in self.bodies.values() if b.carrier is None
            },
            soil=self.ground.deposits(),
            robot_contacts=self._contacts.robot_contacts,
        )

    def soil_total_m3(self) -> float:
        """Return all soil there is less what was dug out of level ground: this never changes."""
        carried = math.fsum(m.cargo.soil_m3 for m in self.machines.values())
        return self.ground.heaped_m3 + carried - self.ground.dug_m3

    def render(self, camera: Camera) -> Picture:
        """Return what a camera sees, RGB of shape (height, width, 3)."""
        for machine in self.machines.values():
            handle = self._handles[machine.id]
            for number, angle in enumerate(machine.joints.values()):
                self._scene.set_joint(handle, number, angle)
            self._looks.show_load(machine, handle, self._body_handles)
        lens = pinhole(camera)
        light = SUN / np.linalg.norm(SUN)
        colours, depth = self._scene.picture(
            (lens.width, lens.height), lens.view_matrix(), lens.projection_matrix(), tuple(light.tolist())
        )
        return shaded(colours, lens.depth_m(depth), lens, light)

    def snapshot(self) -> Snapshot:
        """Return all that another world of the same site needs to go on from here."""
        return Snapshot(
            site=digest(self.site, self.seed),
            steps=self.steps,
            machines={m.id: m.state() for m in self.machines.values()},
            bodies={b.name: BodyState(pose=b.pose, carrier=b.carrier) for b in self.bodies.values()},
            heaps=self.ground.state(),
            dug_m3=self.ground.dug_m3,
            robot_contacts=self._contacts.robot_contacts,
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from a snapshot of this site and seed; the machines stand still until commanded."""
        self.steps = snapshot.steps
        self.ground.restore(snapshot.heaps, snapshot.dug_m3)
        for name, state in snapshot.bodies.items():
            self.bodies[name].restore(state)
        for robot_id, state in snapshot.machines.items():
            self.machines[robot_id].restore(state)
        self._contacts.robot_contacts = snapshot.robot_contacts
        self._contacts.place_machines()
        self._settle_ground()
        self._contacts.update()

    def _leaves(self, machine: Machine, target: tuple[float, float, float]) -> bool:
        """Whether a move leads (farther) off the ground around the site, where the simulated world ends."""
        bounds, (x, y, _) = self.site.bounds, target
        outside = max(bounds.min_x - x, x - bounds.max_x, bounds.min_y - y, y - bounds.max_y)
        before = max(
            bounds.min_x - machine.x, machine.x - bounds.max_x, bounds.min_y - machine.y, machine.y - bounds.max_y
        )
        return outside > EDGE_M and outside > before

    def _settle_ground(self) -> None:
        """Show heaps and things as they now are, and tell what stands in the way."""
        solids: list[Solid] = []
        for heap in self.ground:
            handle = self._looks.show_heap(heap)
            if heap.pile is not None:
                solids.append(Solid(heap.pile, handle, heap.x, heap.y, heap.radius_m * 1.05))
        self._looks.forget_heaps(set(self.ground.heaps))
        for body in self.bodies.values():
            handle = self._body_handles[body.name]
            self._looks.place_body(handle, body)
            if body.solid and body.carrier is None:
                solids.append(Solid(body.name, handle, body.x, body.y, body.radius_m))
        self._contacts.set_solids(solids)

    def _machine(self, entry: RobotEntry, kind: RobotType) -> Machine:
        return _MACHINES[kind.body](entry, kind, self.site.command_timeout_s)
