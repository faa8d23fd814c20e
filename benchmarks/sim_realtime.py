"""How much faster than the clock the simulator runs the default site on one core, all six robots driving and working.

Counted in processor time of this process (it has one busy thread), so other work on the machine does not matter.
"""

import math
import time
from pathlib import Path
from typing import Any, Final

from muster_schemas.site import load_site
from muster_sim.service import TELEMETRY_STEPS, jpeg
from muster_sim.testing import CLOSED, DEEP, OPEN, READY, Operator
from muster_sim.world import World

SITE: Final = Path(__file__).parents[1] / "sites" / "yard.yaml"
BAR: Final = 10.0
SITE_S: Final = 300.0
DIG_CYCLE: Final = ({**READY, "bucket": OPEN}, DEEP, {"bucket": CLOSED}, {**READY, "swing": 1.5}, {"bucket": OPEN})


def measure() -> list[dict[str, Any]]:
    """Return the factor without and with the cameras' pictures (taken, shaded and coded at their rates)."""
    return [
        _row("sim_realtime_factor", _factor(cameras=False)),
        _row("sim_realtime_factor_with_cameras", _factor(cameras=True)),
    ]


def _row(name: str, value: float) -> dict[str, Any]:
    return {"name": name, "value": round(value, 1), "unit": "x", "bar": BAR, "ok": value >= BAR}


def _factor(*, cameras: bool) -> float:
    """Return the site seconds simulated in a second of one core."""
    with World(load_site(SITE)) as world:
        operator = Operator(world)
        filmed = world.site.cameras if cameras else ()
        if filmed:
            world.render(filmed[0])  # the first picture sets up the renderer
        begin = time.process_time()
        due = {camera.id: begin for camera in filmed}
        sent = 0
        while world.time_s < SITE_S:
            _work(operator)
            operator.step()
            if world.steps % TELEMETRY_STEPS == 0:
                sent += sum(len(world.telemetry(robot_id, world.steps).to_json()) for robot_id in world.machines)
            for camera in filmed:
                if time.process_time() >= due[camera.id]:
                    jpeg(world.render(camera))
                    due[camera.id] += 1 / camera.rate_hz
        if not sent:
            raise RuntimeError("no telemetry was made")
        return world.time_s / (time.process_time() - begin)


def _work(operator: Operator) -> None:
    """Twice a second give each robot a new order: all drive in bends, excavators dig and trucks tip meanwhile."""
    world = operator.world
    if world.steps % 30:
        return
    for number, machine in enumerate(world.machines.values()):
        bend = 0.5 * math.sin(0.1 * world.time_s + number)
        operator.drive(machine.id, machine.kind.max_speed_mps * (1 if bend > 0 else -1), bend)
        if "bed" in machine.joints:
            operator.tool(machine.id, bed=1.1 if world.time_s % 12 < 6 else 0.0)
        else:
            operator.tool(machine.id, **DIG_CYCLE[int(world.time_s / 2 + number) % len(DIG_CYCLE)])


if __name__ == "__main__":
    for row in measure():
        print(row)
