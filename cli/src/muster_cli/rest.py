"""The operator's REST interface, as the command uses it. Whatever goes wrong becomes one clear line."""

import secrets
from types import TracebackType
from typing import Any, Self, cast

import httpx
from muster_schemas.mission import Approval, MissionView
from muster_schemas.plan import Plan
from muster_schemas.rpc import ControlReply
from muster_schemas.stops import StopReply
from pydantic import ValidationError

from .errors import CliError


class Unreachable(CliError):  # noqa: N818  (a state of the site, told to the operator)
    """Nothing answers at the interface's address."""


class OperatorApi:
    """A connection to one site's interface."""

    def __init__(self, url: str, token: str | None, transport: httpx.BaseTransport | None = None) -> None:
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._client = httpx.Client(base_url=url, headers=headers, timeout=10.0, transport=transport)
        self._url = url

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.close()

    def submit(self, text: str, priority: int, approval: Approval) -> str:
        """Hand in an instruction and return the id of its mission."""
        body = {"text": text, "priority": priority, "approval": approval}
        headers = {"Idempotency-Key": secrets.token_hex(16)}
        return str(self._call("POST", "/instructions", json=body, headers=headers)["mission_id"])

    def draft(self, text: str) -> Plan:
        """Return the plan that an instruction would get; nothing moves."""
        data = self._call("POST", "/instructions", json={"text": text, "dry_run": True}, timeout=60.0)
        return Plan.model_validate(data["plan"])

    def mission(self, mission_id: str) -> MissionView:
        """Return one mission."""
        return _view(self._call("GET", f"/missions/{mission_id}"))

    def missions(self) -> list[MissionView]:
        """Return the newest missions, newest first."""
        data = self._call("GET", "/missions")
        return [_view(one) for one in data["missions"]]

    def act(self, mission_id: str, action: str) -> ControlReply:
        """Approve, reject, cancel, pause or resume a mission; returns its new state and what the robots answered."""
        return ControlReply.model_validate(self._call("POST", f"/missions/{mission_id}/{action}"))

    def stop(self, robot_id: str | None, *, stop: bool) -> StopReply:
        """Stop or release one robot, or everything; returns what is known of each."""
        where = f"/robots/{robot_id}" if robot_id is not None else ""
        return StopReply.model_validate(self._call("POST", f"{where}/{'stop' if stop else 'release'}"))

    def decide(self, mission_id: str, task_id: str, action: str) -> ControlReply:
        """Retry, skip or plan anew a task that waits for a decision."""
        return ControlReply.model_validate(self._call("POST", f"/missions/{mission_id}/tasks/{task_id}/{action}"))

    def plan(self, mission_id: str) -> dict[str, Any]:
        """Return the plan that can be edited now, in the published form."""
        data = self._call("GET", f"/missions/{mission_id}")
        proposals: dict[str, dict[str, Any]] = data["proposals"]
        plan: dict[str, Any] | None = next(iter(proposals.values()), None) or data["plan"]
        if plan is None:
            raise CliError(f"{mission_id} has no plan yet.")
        return plan

    def edit(self, mission_id: str, plan: dict[str, Any], plan_revision: int) -> None:
        """Replace a plan, if it still is at that revision."""
        self._call(
            "PUT", f"/missions/{mission_id}/plan", json=plan, params={"plan_revision": plan_revision}, timeout=30.0
        )

    def _call(self, method: str, path: str, **rest: Any) -> Any:
        try:
            answer = self._client.request(method, path, **rest)
        except (httpx.ConnectError, httpx.ReadError, httpx.RemoteProtocolError, httpx.ConnectTimeout) as error:
            raise Unreachable(
                f"No site answers at {self._url}. Start one with `muster up`, or set MUSTER_URL."
            ) from error
        except httpx.TimeoutException as error:
            raise Unreachable(f"The site at {self._url} does not answer in time. `muster status` shows why.") from error
        except httpx.HTTPError as error:
            raise CliError(f"{self._url} cannot be asked: {error}") from error
        if answer.is_success:
            return answer.json()
        raise CliError(_problem(answer))


def _view(data: dict[str, Any]) -> MissionView:
    """Return the mission that the interface shows flat, with its tasks without the mission's id and revision."""
    same = {"mission_id": data["mission_id"], "revision": data["revision"]}
    tasks = [{**task, **same, "attempt": task["attempts"]} for task in data["tasks"]]
    try:
        return MissionView.model_validate(
            {"mission": data, "plan": data["plan"], "proposals": data["proposals"], "tasks": tasks}
        )
    except ValidationError as error:
        raise CliError("The site speaks another version of Muster; use the command that came with it.") from error


def _problem(answer: httpx.Response) -> str:
    """Return what a problem document (RFC 9457) says, in one line and then one for each reason."""
    try:
        data: Any = answer.json()
    except ValueError:
        data = None
    if not isinstance(data, dict):
        return f"The site answered {answer.status_code}."
    problem = cast("dict[str, Any]", data)
    lines = [str(problem.get("detail") or problem.get("title") or f"The site answered {answer.status_code}.")]
    reasons = cast("list[dict[str, Any]]", problem.get("reasons") or [])
    lines += [f"  {r['message']}" for r in reasons]
    if answer.status_code == 401:
        lines.append("  Set MUSTER_TOKEN to the site's token.")
    return "\n".join(dict.fromkeys(lines))
