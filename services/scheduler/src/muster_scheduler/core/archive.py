"""Missions that have ended leave the state, so that it does not grow with the site's age; the store keeps them."""

from collections.abc import Iterable
from typing import Final

from .effects import RetractMission, RetractTask
from .events import MissionsArchived
from .state import Mission, State
from .turn import Turn

KEPT_ENDED: Final = 100
"""So many ended missions stay in the state: those that people and the bus ask for most."""


def archivable(state: State, keep: int = KEPT_ENDED) -> list[Mission]:
    """Return the ended missions that may leave the state, all but the `keep` newest, oldest first."""
    ended = sorted((state.missions[m] for s, ids in state.by_state.items() if s.ended for m in ids), key=_number)
    needed = {key[0] for r in state.robots.values() for key in (*r.loose_ends, *r.rule_tasks)}
    return [m for m in ended[: max(len(ended) - keep, 0)] if m.mission_id not in needed]


def forget(turn: Turn, event: MissionsArchived) -> None:
    """Take missions out of the state.

    Raises:
        ValueError: one of them is not there, or is not to be forgotten.

    """
    state = turn.state
    may_go = {m.mission_id for m in archivable(state, keep=0)}
    if not may_go.issuperset(event.mission_ids):
        raise ValueError(f"missions {sorted(set(event.mission_ids) - may_go)} cannot be archived")
    for mission in _taken_out(state, event.mission_ids):
        turn.effects += [RetractTask(mission_id=t.mission_id, task_id=t.task_id) for t in mission.tasks.values()]
        turn.effects.append(RetractMission(mission_id=mission.mission_id))


def _taken_out(state: State, mission_ids: Iterable[str]) -> Iterable[Mission]:
    for mission_id in mission_ids:
        mission = state.missions.pop(mission_id)
        del state.by_state[mission.state][mission_id]
        if mission.idempotency_key is not None:
            del state.by_idempotency_key[mission.idempotency_key]
        yield mission


def _number(mission: Mission) -> int:
    return mission.number
