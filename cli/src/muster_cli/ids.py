"""Ids that people type."""

from muster_schemas.ids import InvalidIdError, check_id

from .errors import CliError


def checked_mission_id(value: str) -> str:
    """Return a mission's id as it is.

    Raises:
        CliError: it cannot be one.

    """
    try:
        return check_id(value, "mission")
    except InvalidIdError as error:
        raise CliError(f"{error}. `muster missions` lists the missions.", 2) from error


def checked_task_id(value: str) -> str:
    """Return a task's id as it is.

    Raises:
        CliError: it cannot be one.

    """
    try:
        return check_id(value, "task")
    except InvalidIdError as error:
        raise CliError(f"{error}. `muster missions ID` shows the tasks of a mission.", 2) from error


def checked_robot_id(value: str) -> str:
    """Return a robot's id as it is.

    Raises:
        CliError: it cannot be one.

    """
    try:
        return check_id(value, "robot")
    except InvalidIdError as error:
        raise CliError(f"{error}. `muster stop` without a robot stops all.", 2) from error
