"""The typed gate between a language model and the robots: what a plan must fulfil before anything moves.

Pure: the planner calls it to repair and explain, the scheduler calls it again because nobody else can be trusted with
what reaches a robot.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from graphlib import CycleError, TopologicalSorter

from .ids import InvalidIdError, check_id
from .mission import Reason
from .plan import MAX_TASKS, InstructionFunction, Plan, PlanTask
from .robot import RobotCard
from .skills import Catalogue, ObjectNeed, Skill


def check_plan(
    plan: Plan,
    roster: Sequence[RobotCard],
    objects: Collection[str],
    catalogue: Catalogue,
    *,
    most: int = MAX_TASKS,
) -> list[Reason]:
    """Return every reason against the plan; an empty list means that it may run.

    Args:
        plan: as parsed.
        roster: the robots that are on the site now.
        objects: names in the object map now.
        catalogue: the site's skills.
        most: tasks that it may have; more than the default only within a process, for a message holds no more.

    """
    if not plan.tasks:
        return [Reason(code="empty_plan", message="The plan has no task.")]
    if len(plan.tasks) > most:
        return [Reason(code="too_many_tasks", message=f"The plan has more than {most} tasks.")]
    reasons = list(_check_names_and_order(plan))
    for task in plan.tasks:
        reasons += _check_task(task, roster, objects, catalogue)
    return reasons


def unknown_objects(reasons: Iterable[Reason], plan: Plan, objects: Collection[str]) -> list[str]:
    """Return the objects that the plan names and the map lacks: what the cameras should look for first."""
    if not any(r.code == "unknown_object" for r in reasons):
        return []
    named = (o for t in plan.tasks for o in t.instruction_function.object_keywords)
    return sorted({o for o in named if o not in objects})


def _check_names_and_order(plan: Plan) -> Iterable[Reason]:
    names = Counter(t.task for t in plan.tasks)
    for name in sorted(n for n, times in names.items() if times > 1):
        yield Reason(code="repeated_name", task=name, message=f"More than one task is named {name!r}.")
    for task in plan.tasks:
        for before in task.instruction_function.dependencies:
            if before not in names:
                yield Reason(
                    code="unknown_dependency",
                    task=task.task,
                    message=f"{task.task} waits for {before!r}, which is not in the plan.",
                )
    try:
        TopologicalSorter({t.task: t.instruction_function.dependencies for t in plan.tasks}).prepare()
    except CycleError as error:
        circle: list[str] = error.args[1]
        yield Reason(code="cycle", message=f"These tasks wait for each other: {' -> '.join(circle)}."[:1000])


def _check_task(
    task: PlanTask, roster: Sequence[RobotCard], objects: Collection[str], catalogue: Catalogue
) -> Iterable[Reason]:
    function = task.instruction_function
    if function.name not in catalogue:
        known = ", ".join(s.name for s in catalogue)
        yield Reason(
            code="unknown_skill",
            task=task.task,
            message=f"There is no skill {function.name!r}. Skills: {known}."[:1000],
        )
        return
    skill = catalogue[function.name]
    yield from _check_robots(task, skill, roster)
    yield from _check_objects(task, skill, objects)


def _check_objects(task: PlanTask, skill: Skill, objects: Collection[str]) -> Iterable[Reason]:
    wanted = task.instruction_function.object_keywords
    if skill.objects is ObjectNeed.REQUIRED and not wanted:
        yield Reason(code="object_missing", task=task.task, message=f"{task.task} does not say at which object.")
    if skill.objects is ObjectNeed.NONE and wanted:
        yield Reason(
            code="object_unwanted", task=task.task, message=f"{task.task} names an object, but {skill.name} takes none."
        )
        return
    for name in wanted:
        try:
            check_id(name, "object")
        except InvalidIdError as error:
            yield Reason(code="invalid_object", task=task.task, message=f"The {error}.")
            continue
        if name not in objects:
            known = ", ".join(sorted(objects)) or "none"
            message = f"There is no {name!r} on the site. Objects seen: {known}."
            yield Reason(code="unknown_object", task=task.task, message=message[:1000])


def _check_robots(task: PlanTask, skill: Skill, roster: Sequence[RobotCard]) -> Iterable[Reason]:
    function = task.instruction_function
    cards = {c.robot_id: c for c in roster}
    if skill.fleet_wide:
        left_out = set(cards) - set(function.robot_ids)
        if function.robot_ids and left_out:
            missing = ", ".join(sorted(left_out))
            message = f"{skill.name} is for the whole fleet, but {task.task} leaves out {missing}."
            yield Reason(code="not_all_robots", task=task.task, message=message[:1000])
    elif not function.robot_ids and not function.robot_type:
        yield Reason(code="robot_missing", task=task.task, message=f"{task.task} does not say which robots.")
    if len(set(function.robot_ids)) != len(function.robot_ids):
        yield Reason(code="repeated_robot", task=task.task, message=f"{task.task} names a robot twice.")
    for robot_id in function.robot_ids:
        if robot_id not in cards:
            known = ", ".join(sorted(cards)) or "none"
            message = f"There is no robot {robot_id!r}. Robots: {known}."
            yield Reason(code="unknown_robot", task=task.task, message=message[:1000])
        else:
            yield from _check_ability(task, skill, cards[robot_id])
    yield from _check_types(task, function, skill, roster)


def _check_types(
    task: PlanTask, function: InstructionFunction, skill: Skill, roster: Sequence[RobotCard]
) -> Iterable[Reason]:
    for robot_type in function.robot_type:
        of_type = [c for c in roster if c.type == robot_type]
        if not of_type:
            known = ", ".join(sorted({c.type for c in roster})) or "none"
            yield Reason(
                code="unknown_type",
                task=task.task,
                message=f"There is no robot of type {robot_type!r}. Types: {known}."[:1000],
            )
            continue
        able = [c for c in of_type if skill.name in c.skills]
        wanted = function.robot_count
        if not able or (skill.robot_types and robot_type not in skill.robot_types):
            yield Reason(code="wrong_type", task=task.task, message=f"A {robot_type} cannot do {skill.name}.")
        elif isinstance(wanted, int) and wanted > len(able):
            yield Reason(
                code="too_few_robots",
                task=task.task,
                message=f"{task.task} wants {wanted} of type {robot_type}; the site has {len(able)} that can do it.",
            )


def _check_ability(task: PlanTask, skill: Skill, card: RobotCard) -> Iterable[Reason]:
    if skill.name not in card.skills or (skill.robot_types and card.type not in skill.robot_types):
        yield Reason(
            code="wrong_type", task=task.task, message=f"{card.robot_id} is a {card.type} and cannot do {skill.name}."
        )
