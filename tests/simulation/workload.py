"""Plans that the gate lets pass: any skills, named robots, teams and selectors, any acyclic graph."""

import random

from muster_scheduler.testing import planned
from muster_schemas.plan import PlanTask
from muster_schemas.site import Site

ON_MACHINES = {
    "Excavation": ("excavator",),
    "ExcavatorUnloading": ("excavator",),
    "DumpLoading": ("dump_truck",),
    "DumpUnloading": ("dump_truck",),
    "target_area_for_specific_robots": ("excavator", "dump_truck"),
    "return_to_start_for_specific_robots": ("excavator", "dump_truck"),
    "avoid_areas_for_specific_robots": ("excavator", "dump_truck"),
    "allow_areas_for_specific_robots": ("excavator", "dump_truck"),
}


def random_plan(rng: random.Random, site: Site, most_tasks: int = 5) -> tuple[PlanTask, ...]:
    """Return a plan for the robots of a site."""
    things = [t.name for t in site.things]
    tasks: list[PlanTask] = []
    for number in range(rng.randint(1, most_tasks)):
        skill = rng.choice(list(ON_MACHINES))
        kind = rng.choice(ON_MACHINES[skill])
        able = [r.id for r in site.robots if r.type in ON_MACHINES[skill]]
        after = [t.task for t in tasks if rng.random() < 0.4]
        objects = rng.sample(things, rng.randint(1, 2)) if "area" in skill else []
        if rng.random() < 0.6:
            team = rng.sample(able, min(len(able), rng.choice([1, 1, 2, 3])))
            tasks.append(planned(f"n{number}", skill, team, after, objects=objects))
        else:
            of_kind = sum(r.type == kind for r in site.robots)
            count = rng.choice([*range(1, of_kind + 1), "all"])
            tasks.append(planned(f"n{number}", skill, (), after, objects=objects, types=[kind], count=count))
    return tuple(tasks)
