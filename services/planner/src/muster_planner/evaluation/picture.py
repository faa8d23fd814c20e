"""An evaluation as a picture: the table above, SR with and without dependencies below."""

import importlib.util
from pathlib import Path
from typing import Any

from muster_planner.errors import SetupError

from . import report
from .measures import Evaluation
from .paper import REPORTED

_BARS = (
    ("with dependencies", "with_dependencies", "#1f6f8b"),
    ("without: queues", "queues", "#e07a3f"),
    ("without: list", "listed", "#c9ada7"),
    ("without: list, order only", "listed_in_order", "#9a8c98"),
)


def require() -> None:
    """Find out before the long work whether a picture can be drawn.

    Raises:
        SetupError: matplotlib is not installed.

    """
    if importlib.util.find_spec("matplotlib") is None:
        raise SetupError("Pictures need matplotlib. Install it with the planner's extra `evaluation`.")


def draw(evaluation: Evaluation, target: Path) -> None:
    """Write the picture, of the kind that the file's name says (png, svg, pdf)."""
    from matplotlib.figure import Figure  # noqa: PLC0415 (only pictures need it)

    figure: Any = Figure(figsize=(9, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(1, 2))
    _table(above, evaluation)
    _bars(below, evaluation)
    # without a date in it, so that the same numbers give the same file
    figure.savefig(target, dpi=110, metadata={"Software": None} if target.suffix == ".png" else {})


def _table(axes: Any, evaluation: Evaluation) -> None:
    axes.axis("off")
    axes.set_title(report.title(evaluation), fontsize=10, loc="left")
    cells = axes.table(report.table(evaluation), colLabels=report.HEAD, loc="center", cellLoc="center")
    cells.auto_set_font_size(value=False)
    cells.set_fontsize(9)
    cells.scale(1, 1.35)


def _bars(axes: Any, evaluation: Evaluation) -> None:
    width = 0.8 / len(_BARS)
    levels = [row.level for row in evaluation.ablation]
    for n, (label, field, colour) in enumerate(_BARS):
        heights: list[float] = [getattr(row, field) for row in evaluation.ablation]
        places = [at + (n - (len(_BARS) - 1) / 2) * width for at in range(len(levels))]
        drawn = axes.bar(places, heights, width, label=label, color=colour)
        axes.bar_label(drawn, fmt="%.2f", fontsize=7, padding=1)
    best = max(REPORTED, key=lambda r: r.l3[0])
    reported = {"L1": best.l1[0], "L2": best.l2[0], "L3": best.l3[0]}
    for at, level in enumerate(levels):
        if level in reported:
            label = f"paper's best, {best.model}, on its own set" if level == "L1" else None
            axes.hlines(reported[level], at - 0.45, at + 0.45, colors="black", linestyles="dashed", label=label)
    axes.set_xticks(range(len(levels)), levels)
    axes.set_ylim(0, 1.12)
    axes.set_ylabel("SR")
    axes.set_title("Success rate with and without dependencies", fontsize=10, loc="left")
    axes.legend(fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.08), frameon=False)
