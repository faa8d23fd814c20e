"""`make bench`: runs every `benchmarks/*.py` that has `measure()`, prints a table, writes `benchmarks/results.json`.

`measure()` returns one row or several, each a mapping with `name`, `value`, `unit`, `bar` (the limit in words or as a
number, or None) and `ok`. One that cannot run becomes a row with its error, and the exit code is 1.
"""

import importlib
import json
import pkgutil
import sys
import traceback
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, cast

from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.table import Table

import benchmarks

RESULTS = Path(__file__).with_name("results.json")
Measure = Callable[[], Mapping[str, Any] | Iterable[Mapping[str, Any]]]


class Row(BaseModel):
    """One measured number against its bar."""

    model_config = ConfigDict(extra="allow")

    name: str
    value: float | None
    unit: str
    bar: float | str | None
    ok: bool


def measures(only: Iterable[str]) -> dict[str, Measure]:
    """Return the benchmarks by module name; with names given, only those."""
    wanted = set(only)
    names = sorted(m.name for m in pkgutil.iter_modules(benchmarks.__path__) if not m.name.startswith("_"))
    if unknown := wanted - set(names):
        raise SystemExit(f"no such benchmark: {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    found: dict[str, Measure] = {}
    for name in names:
        if not wanted or name in wanted:
            found[name] = _measure_of(name)
    return found


def _measure_of(name: str) -> Measure:
    """Return what measures; the import is part of it, since an import can fail like the rest."""

    def measure() -> Mapping[str, Any] | Iterable[Mapping[str, Any]]:
        function = getattr(importlib.import_module(f"benchmarks.{name}"), "measure", None)
        return cast("Measure", function)() if function else ()

    return measure


def run(name: str, measure: Measure) -> list[Row]:
    """Return the rows of one benchmark; a row with its error if it cannot run."""
    try:
        measured = measure()
        rows = cast("list[object]", [measured] if isinstance(measured, Mapping) else list(measured))
        return [Row.model_validate(row) for row in rows]
    except Exception as error:  # noqa: BLE001  (one that fails must not hide the others)
        traceback.print_exc()
        told = {"name": name, "value": None, "unit": "", "bar": None, "ok": False}
        return [Row.model_validate(told | {"error": f"{type(error).__name__}: {error}"})]


def table(rows: Iterable[Row]) -> Table:
    """Return the rows for people."""
    shown = Table(box=None, pad_edge=False, header_style="bold")
    for column, justify in (("what", "left"), ("value", "right"), ("unit", "left"), ("bar", "right"), ("", "left")):
        shown.add_column(column, justify="right" if justify == "right" else "left")
    for row in rows:
        extra = row.model_extra or {}
        value = str(extra.get("error", "")) if row.value is None else f"{row.value:.4g}"
        bar = "" if row.bar is None else str(row.bar)
        shown.add_row(row.name, value, row.unit, bar, "[green]ok[/]" if row.ok else "[bold red]not met[/]")
    return shown


def main(arguments: list[str]) -> int:
    """Measure, print, write; returns 1 if anything could not run or missed its bar."""
    console = Console()
    rows: list[Row] = []
    for name, measure in measures(arguments).items():
        with console.status(f"measuring {name}"):
            rows += run(name, measure)
    console.print(table(rows))
    if arguments:
        console.print("Only some were measured, so results.json stays as it is.", style="dim")
    else:
        RESULTS.write_text(json.dumps([row.model_dump() for row in rows], indent=2) + "\n")
    return int(any(not row.ok for row in rows))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
