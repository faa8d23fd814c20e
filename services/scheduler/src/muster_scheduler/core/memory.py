"""The state as JSON and back: what a snapshot of the journal holds. Pure.

It follows the types of `State`, so a new field travels by itself. Like an event's, a field may be added with a default
but never be renamed or taken away. What can be rebuilt is left out and rebuilt here.
"""

from pydantic import TypeAdapter

from .graph import TaskGraph
from .state import Mission, State

_STATE = TypeAdapter(State)
_MISSION = TypeAdapter(Mission)


def dump(state: State) -> bytes:
    """Return the whole state; its agenda must be empty, as it is after every event's decisions."""
    return _STATE.dump_json(state)


def load(body: bytes) -> State:
    """Return the state that was dumped.

    Raises:
        ValueError: it is none.

    """
    state = _STATE.validate_json(body)
    for mission in state.missions.values():
        _rebuild(mission)
    return state


def dump_mission(mission: Mission) -> bytes:
    """Return one mission with its tasks."""
    return _MISSION.dump_json(mission)


def load_mission(body: bytes) -> Mission:
    """Return the mission that was dumped.

    Raises:
        ValueError: it is none.

    """
    mission = _MISSION.validate_json(body)
    _rebuild(mission)
    return mission


def _rebuild(mission: Mission) -> None:
    mission.graph = TaskGraph({t.task_id: t.dependencies for t in mission.tasks.values()})
