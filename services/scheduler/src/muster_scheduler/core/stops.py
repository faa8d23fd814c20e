"""Stops of one robot and of everything: journaled wishes, sent to each agent until its present life has obeyed.

A robot is stopped while it or the whole site is. Its work stands still with it, and goes on after the release.
"""

from collections.abc import Iterable

from muster_schemas.rpc import ErrorCode
from muster_schemas.stops import NO_ANSWER, NOT_REACHABLE, StopReply, StopRequest, StopRobots, StopStatus

from . import readiness, requests
from .effects import HushStop, SendStop
from .errors import NotPossibleError
from .events import StopOrdered
from .state import Presence, Robot, State, StopOrder
from .turn import Turn


def order(turn: Turn, event: StopOrdered) -> None:
    """Stop or release one robot or all.

    Raises:
        NotPossibleError: there is no such robot, or it cannot be released while the whole site is stopped.

    """
    state = turn.state
    if event.robot_id is None:
        state.stopped = event.stop
    else:
        robot = state.robots.get(event.robot_id)
        if robot is None:
            known = ", ".join(sorted(state.robots)) or "none"
            raise NotPossibleError(ErrorCode.NOT_FOUND, f"there is no robot {event.robot_id}; robots: {known}"[:2000])
        if state.stopped and not event.stop:
            raise NotPossibleError(
                ErrorCode.CONFLICT, f"the whole site is stopped, and {event.robot_id} with it: release the site first"
            )
        robot.stopped_alone = event.stop
    for robot in _meant(state, event.robot_id):
        bring_in_line(turn, robot)


def changes_nothing(state: State, wish: StopRobots) -> bool:
    """Return whether what is wanted stopped or released is so already."""
    if wish.robot_id is None:
        return state.stopped == wish.stop
    robot = state.robots.get(wish.robot_id)
    return robot is not None and robot.stopped_alone == wish.stop and (wish.stop or not state.stopped)


def bring_in_line(turn: Turn, robot: Robot) -> None:
    """Give a robot a new order if what is wanted of it is not what it was told last."""
    state = turn.state
    wanted = state.stopped or robot.stopped_alone
    if wanted == robot.stopped:
        return
    # grows over everything that has been, even if this journal is younger than the agents'
    state.stop_number = max(state.stop_number + 1, int(turn.now * 1000))
    robot.stop = StopOrder(number=state.stop_number, stopped=wanted)
    ask(turn, robot)
    holder = state.task(robot.holder) if robot.holder else None
    if holder is not None and holder.active:
        requests.sync(turn, holder)
    readiness.fleet_changed(turn, robot)


def ask(turn: Turn, robot: Robot) -> None:
    """Send the order to a robot's present life, unless that has obeyed it."""
    stop = robot.stop
    if stop is None or stop.obeyed_by == robot.card.boot_id:
        return
    if stop.obeyed_by is not None and not stop.stopped:
        return  # a release that an earlier life has obeyed stands in the agent's own journal
    request = StopRequest(
        robot_id=robot.card.robot_id, number=stop.number, stopped=stop.stopped, issued_at=turn.state.now
    )
    turn.effects.append(SendStop(request=request))


def is_news(state: State, status: StopStatus) -> bool:
    """Return whether an agent's word tells that the order is obeyed, which was not known yet."""
    robot = state.robots.get(status.robot_id)
    if robot is None or robot.stop is None or status.boot_id != robot.card.boot_id:
        return False
    stop = robot.stop
    obeyed = status.number == stop.number and (status.standing or not status.stopped)
    return obeyed and stop.obeyed_by != status.boot_id


def hear(turn: Turn, status: StopStatus) -> None:
    """Take in that a robot has obeyed."""
    if not is_news(turn.state, status):
        return
    robot = turn.state.robots[status.robot_id]
    if robot.stop is not None:
        robot.stop.obeyed_by = status.boot_id
        robot.stop.was_busy = robot.stop.was_busy or status.was_busy
        turn.effects.append(HushStop(robot_id=status.robot_id))


def known(state: State, robot_id: str | None) -> StopReply:
    """Return what is known of one robot, or of all."""
    return StopReply(
        site_stopped=state.stopped, robots={r.card.robot_id: _known(r) for r in _meant(state, robot_id)}
    )  # fmt: skip


def all_said(state: State, robot_id: str | None) -> bool:
    """Return whether every robot that can be reached has said that it has obeyed."""
    return all(_known(r) != NO_ANSWER for r in _meant(state, robot_id))


def _known(robot: Robot) -> str:
    stop = robot.stop
    if stop is None:
        return "not stopped"
    if stop.obeyed_by is not None and (stop.obeyed_by == robot.card.boot_id or not stop.stopped):
        word = ("stopped" if stop.was_busy else "was idle") if stop.stopped else "released"
        return word if robot.presence is not Presence.OFFLINE else f"{word}; not reachable now"
    return NOT_REACHABLE if robot.presence is Presence.OFFLINE else NO_ANSWER


def _meant(state: State, robot_id: str | None) -> Iterable[Robot]:
    if robot_id is None:
        return [state.robots[r] for r in sorted(state.robots)]
    return [state.robots[robot_id]] if robot_id in state.robots else []
