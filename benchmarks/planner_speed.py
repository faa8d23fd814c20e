"""How long the embedded model takes for a plan, repairs included, and how much memory its process needs.

Measured in a process of its own with the site's file, as `muster plan --batch` does it; the first plan is not counted,
because it reads the prompt's fixed part, which is kept for all that follow.
"""

import resource
import statistics
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

from muster_planner.offline import open_offline
from muster_schemas.site import load_site

INSTRUCTIONS: Final = Path(__file__).with_name("instructions.txt")
SITE: Final = Path(__file__).parents[1] / "sites" / "yard.yaml"
P95_BAR_S: Final = 2.0
RSS_BAR_MB: Final = 600.0


def measure() -> list[dict[str, Any]]:
    """Return the time of a plan (95th percentile and mean) and the process's largest memory."""
    with ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn")) as process:
        seconds, rss_mb = process.submit(_plan_all).result()
    p95 = statistics.quantiles(seconds, n=20, method="inclusive")[-1]
    return [
        _row("plan_p95_s", p95, "s", P95_BAR_S),
        _row("plan_mean_s", statistics.mean(seconds), "s", None),
        _row("plan_rss_mb", rss_mb, "MB", RSS_BAR_MB),
    ]


def _plan_all() -> tuple[list[float], float]:
    """Return each instruction's time in seconds, and the largest resident size of this process in MB."""
    texts = [line for line in INSTRUCTIONS.read_text(encoding="utf-8").splitlines() if line]
    with open_offline(load_site(SITE)) as planner:
        planner.plan(texts[0])
        lines = [planner.plan(text) for text in texts]
    if not any(line.plan for line in lines):
        raise RuntimeError(f"none of {len(texts)} instructions was planned: {lines[0].error}")
    return [line.latency_s for line in lines], resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _row(name: str, value: float, unit: str, bar: float | None) -> dict[str, Any]:
    return {"name": name, "value": round(value, 3), "unit": unit, "bar": bar, "ok": bar is None or value <= bar}


if __name__ == "__main__":
    for row in measure():
        print(row)
