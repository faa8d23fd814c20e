"""Planning without services: robots and objects from the site's file, one instruction or a whole file of them."""

import asyncio
import json
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from muster_schemas.mission import Reason
from muster_schemas.plan import Plan
from muster_schemas.site import Site

from .drafting import Outcome, draft_plan
from .errors import PlanningError
from .instructions import InstructionError, clean_instruction
from .llm import PlanningModel, open_model
from .published import published_form
from .scenes import FileScene

Progress = Callable[[int, int], None]
"""Called after each line with (lines done, lines in all)."""

_MAX_LINE = 64 * 1024


@dataclass(frozen=True)
class PlannedLine:
    """The answer to one line: `plan`, or `error` in words (and `reasons`, if the instruction is why)."""

    id: str
    plan: Plan | None
    latency_s: float
    error: str | None
    reasons: tuple[Reason, ...] = ()
    failure: PlanningError | None = None
    """The model's error, if that and not the instruction is why there is no plan."""

    def to_json(self) -> str:
        """Return the line that stands in the output file (without its end)."""
        plan = published_form(self.plan) if self.plan else None
        return json.dumps({"id": self.id, "plan": plan, "latency_s": round(self.latency_s, 4), "error": self.error})


@dataclass(frozen=True)
class BatchSummary:
    """How many lines there were and how many of them gave a plan."""

    lines: int
    planned: int


class OfflinePlanner:
    """A loaded model over a site's file; made by `open_offline`."""

    def __init__(self, model: PlanningModel, site: Site, runner: asyncio.Runner) -> None:
        self._model = model
        self._scene = FileScene(site)
        self._runner = runner

    def plan(self, text: str, *, id: str = "") -> PlannedLine:  # noqa: A002 (the field's name in the files)
        """Return the plan for one instruction or the reasons why there is none; never raises for a bad text."""
        begin = time.perf_counter()
        try:
            cleaned = clean_instruction(text)
        except InstructionError as error:
            return PlannedLine(id, None, time.perf_counter() - begin, str(error))
        outcome = self._runner.run(draft_plan(cleaned, self._model, self._scene))
        return _line(id, outcome, time.perf_counter() - begin)


@contextmanager
def open_offline(
    site: Site, planner: str = "embedded", *, wrap: Callable[[PlanningModel], PlanningModel] | None = None
) -> Generator[OfflinePlanner]:
    """Load the model once for many instructions.

    Args:
        site: what is there.
        planner: the model, as `MUSTER_PLANNER` says it.
        wrap: makes of the model another that asks it.

    Raises:
        SetupError: the model cannot be had; the message says what to do.

    """
    with asyncio.Runner() as runner:
        opened = open_model(planner)
        model = runner.run(opened.__aenter__())
        try:
            yield OfflinePlanner(wrap(model) if wrap else model, site, runner)
        finally:
            runner.run(opened.__aexit__(None, None, None))


def plan_one(text: str, *, site: Site, planner: str = "embedded") -> PlannedLine:
    """Return the plan for one instruction.

    Raises:
        SetupError: the model cannot be had; the message says what to do.

    """
    with open_offline(site, planner) as offline:
        return offline.plan(text)


def plan_batch(
    source: Path,
    target: Path,
    *,
    site: Site,
    planner: str = "embedded",
    progress: Progress | None = None,
) -> BatchSummary:
    """Plan each line `{"id","text"}` of `source` into a line `{"id","plan","latency_s","error"}` of `target`.

    A line that cannot be planned gives a line with its `error`; nothing in the input stops the batch. Each line is
    written as soon as it is done, so what is there after an interruption is whole.

    Raises:
        OSError: `source` cannot be read or `target` not be written.
        SetupError: the model cannot be had; the message says what to do.

    """
    lines = [line for line in source.read_bytes().splitlines() if line.strip()]
    planned = 0
    with open_offline(site, planner) as offline, target.open("w", encoding="utf-8", newline="\n") as out:
        for done, answer in enumerate(_plan_lines(offline, lines), start=1):
            out.write(answer.to_json() + "\n")
            out.flush()
            planned += answer.plan is not None
            if progress:
                progress(done, len(lines))
    return BatchSummary(lines=len(lines), planned=planned)


def _plan_lines(offline: OfflinePlanner, lines: Iterable[bytes]) -> Iterator[PlannedLine]:
    for number, line in enumerate(lines, start=1):
        fields = _parse(line)
        line_id, text = str(fields.get("id", f"line-{number}")), fields.get("text")
        if isinstance(text, str):
            yield offline.plan(text, id=line_id)
        else:
            wrong = f'Line {number} is not of the form {{"id": "...", "text": "..."}} in at most {_MAX_LINE} bytes.'
            yield PlannedLine(line_id, None, 0.0, wrong)


def _parse(line: bytes) -> dict[str, Any]:
    """Return the line's fields; none if it is no JSON object or too long."""
    if len(line) > _MAX_LINE:
        return {}
    try:
        data: Any = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return cast("dict[str, Any]", data) if isinstance(data, dict) else {}


def _line(line_id: str, outcome: Outcome, latency_s: float) -> PlannedLine:
    error = None if outcome.plan else " ".join(r.message for r in outcome.reasons)
    return PlannedLine(line_id, outcome.plan, latency_s, error, outcome.reasons, outcome.failure)
