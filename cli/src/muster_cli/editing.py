"""Editing a plan that awaits approval: in the editor, or from a file. What is refused changes nothing and is kept."""

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from muster_schemas.mission import MissionStatus, MissionView
from muster_schemas.plan import Plan
from pydantic import ValidationError
from rich.console import Console
from rich.prompt import Confirm

from .errors import CliError
from .rest import OperatorApi
from .settings import editor


def edit_from_file(api: OperatorApi, mission_id: str, file: Path, console: Console) -> None:
    """Replace the plan by the one in a file.

    Raises:
        CliError: the file cannot be read or is no plan, or the site refuses it; nothing has changed.

    """
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise CliError(f"{file} cannot be read: {error}", 2) from error
    view = _editable(api, mission_id)
    _put(api, view, text)
    console.print(f"{mission_id}: the plan is replaced; it still awaits approval", highlight=False)


def edit_in_editor(api: OperatorApi, mission_id: str, console: Console) -> None:
    """Open the plan in the editor that VISUAL or EDITOR names; a refused edit may be corrected.

    Raises:
        CliError: the last edit was refused; the message says where it is kept.

    """
    view = _editable(api, mission_id)
    before = json.dumps(api.plan(mission_id), indent=2) + "\n"
    with tempfile.NamedTemporaryFile("w", prefix=f"muster-edit-{mission_id}-", suffix=".json", delete=False) as opened:
        opened.write(before)
    kept = Path(opened.name)
    while True:
        _open_editor(kept)
        text = kept.read_text(encoding="utf-8", errors="replace")
        if text == before:
            kept.unlink()
            console.print(f"{mission_id}: nothing was changed", highlight=False)
            return
        try:
            _put(api, view, text)
        except CliError as error:
            console.print(str(error), style="red", markup=False)
            if console.is_interactive and Confirm.ask("Edit it again?", console=console, default=True):
                continue
            raise CliError(
                f"Nothing was changed. It is kept: `muster edit {mission_id} --file {kept}` sends it again."
            ) from error
        kept.unlink()
        console.print(f"{mission_id}: the plan is replaced; it still awaits approval", highlight=False)
        return


def _open_editor(file: Path) -> None:
    command = editor()
    try:
        subprocess.run([*command, str(file)], check=True)  # noqa: S603  (the user's own editor)
    except (OSError, subprocess.CalledProcessError) as error:
        raise CliError(
            f"The editor {command[0]} did not work: {error}. EDITOR names another; or use --file."
        ) from error


def _editable(api: OperatorApi, mission_id: str) -> MissionView:
    view = api.mission(mission_id)
    if view.mission.state is not MissionStatus.AWAITING_APPROVAL and not view.proposals:
        state = view.mission.state.value.replace("_", " ")
        raise CliError(f"{mission_id} is {state}; only a plan that awaits approval can be edited.")
    return view


def _put(api: OperatorApi, view: MissionView, text: str) -> None:
    try:
        data: Any = json.loads(text)
        Plan.model_validate(data)
    except ValueError as error:
        raise CliError(_why(error)) from error
    api.edit(view.mission.mission_id, data, view.mission.plan_revision)


def _why(error: ValueError) -> str:
    if not isinstance(error, ValidationError):
        return f"That is no JSON: {error}"
    problems = [f"  {'.'.join(map(str, e['loc'])) or 'plan'}: {e['msg']}" for e in error.errors()[:10]]
    return "\n".join(["That is no plan:", *problems])
