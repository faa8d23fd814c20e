"""Robots and objects come and go; the scheduler itself comes back."""

import heapq

from muster_schemas.skills import Catalogue

from . import attempts, failures, lost, readiness, requests, stops
from .effects import PublishAreas, PublishMission, PublishTask
from .events import ObjectsChanged, RobotOffline, RobotOnline, RulesObeyed, Started
from .state import Awaits, Presence, Robot
from .turn import Turn

RECENT_ENDED = 100
"""So many ended missions are published again at start-up, for those who ask the bus for last values."""


def seen(turn: Turn, event: Started | RobotOnline | RobotOffline | RulesObeyed | ObjectsChanged) -> None:
    """Take in what the scheduler sees of the site and of itself."""
    match event:
        case Started():
            started(turn, event)
        case RobotOnline():
            robot_online(turn, event)
        case RobotOffline():
            robot_offline(turn, event)
        case ObjectsChanged():
            objects_changed(turn, event)
        case RulesObeyed():
            robot = turn.state.robots.get(event.robot_id)
            if robot is not None:
                attempts.obeyed(turn, robot, event.revision)


def started(turn: Turn, event: Started) -> None:
    """Begin a new epoch: what is under way goes on, and every request that waits for an answer is sent anew."""
    state = turn.state
    state.epoch = event.epoch
    state.policy = event.policy
    state.catalogue = Catalogue.with_site(event.skills)
    state.objects = set()
    state.agenda.tasks.clear()
    state.agenda.robots.clear()
    state.agenda.missions.clear()
    turn.effects.append(PublishAreas(rules=state.rules))
    for robot in state.robots.values():
        robot.presence = Presence.UNSEEN
        for loose in robot.loose_ends.values():
            loose.asked = None
        requests.chase(turn, robot)
        stops.ask(turn, robot)
    ended = [m for s, ids in state.by_state.items() if s.ended for m in ids]
    ended.sort(key=lambda m: state.missions[m].number)
    for mission_id in ended[-RECENT_ENDED:]:
        mission = state.missions[mission_id]
        turn.effects.append(PublishMission(mission))
        turn.effects += [PublishTask(t) for t in mission.tasks.values()]
    for status, ids in state.by_state.items():
        for mission_id in () if status.ended else ids:
            mission = state.missions[mission_id]
            turn.touch_mission(mission)
            for task in mission.tasks.values():
                for run in task.runs.values() if task.active else ():
                    run.asked = None
                if task.active:
                    requests.sync(turn, task)
                else:
                    readiness.refresh(turn, task)
                if task.awaits is Awaits.PLANNER:
                    turn.effects.append(failures.replan_request(mission, task))
                turn.touch(task)


def robot_online(turn: Turn, event: RobotOnline) -> None:
    """Let a robot be given work; if its agent has a new life, ask it what became of the old one's."""
    robot = turn.state.robots.get(event.card.robot_id)
    if robot is None:
        robot = turn.state.robots[event.card.robot_id] = Robot(card=event.card)
    robot.card = event.card
    robot.presence = Presence.ONLINE
    robot.lost_at = None
    stops.bring_in_line(turn, robot)
    stops.ask(turn, robot)
    requests.chase(turn, robot)
    _work_of(turn, robot)
    readiness.fleet_changed(turn, robot)


def robot_offline(turn: Turn, event: RobotOffline) -> None:
    """Take a robot as lost: what it does is unknown, and nothing of it is given to another."""
    robot = turn.state.robots.get(event.robot_id)
    if robot is None:
        return
    robot.presence = Presence.OFFLINE
    robot.lost_at = turn.now if robot.lost_at is None else robot.lost_at
    waiting = turn.state.wanting_robot.get(robot.card.robot_id)
    for task in [turn.state.task(key) for key in waiting.waiting] if waiting else ():
        if task is not None:
            lost.watch(turn, task)
    _work_of(turn, robot)
    readiness.fleet_changed(turn, robot)


def _work_of(turn: Turn, robot: Robot) -> None:
    for key in [*robot.rule_tasks, *([robot.holder] if robot.holder else [])]:
        task = turn.state.task(key)
        if task is not None and task.active:
            lost.watch(turn, task)
            requests.sync(turn, task)
            attempts.settle(turn, task)


def objects_changed(turn: Turn, event: ObjectsChanged) -> None:
    """Let the tasks look again that waited for a name; those that could start notice what has gone."""
    state = turn.state
    state.objects |= set(event.appeared)
    state.objects -= set(event.gone)
    for name in (*event.appeared, *event.gone):
        for key in list(state.wanting_object.get(name, ())):
            task = state.task(key)
            if task is not None:
                readiness.refresh(turn, task)


def tick(turn: Turn) -> None:
    """Look at the tasks whose time has come."""
    timers = turn.state.timers
    while timers and timers[0][0] <= turn.now:
        _, key = heapq.heappop(timers)
        task = turn.state.task(key)
        if task is not None and not task.state.ended:
            attempts.time_passed(turn, task)
