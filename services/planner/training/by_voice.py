# pyright: basic
"""What saved results say: estimates with one voice left out, and SR against tokens and against voices.

    python -m training.by_voice RESULTS... [--picture curves.png]

RESULTS are files that `training.evaluate --out` or `muster evaluate --out` wrote. Their labels (`--label NAME=VALUE`)
say how the model was trained:

    held_out=voice7     the voice that this run left out: the result on it estimates how an unknown person fares
    tokens=2000000      tokens trained on
    voices=65           voices trained on
    run=first           results of one run make one curve against tokens

A result with `held_out` counts in the estimate; one without it is a point of the curves, if it has the label. Several
data sets in one result are split by voice.
"""

import argparse
import statistics
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from muster_planner.evaluation.measures import Answer, Evaluation

LEVELS = ("L1", "L2", "L3")


@dataclass(frozen=True)
class Share:
    """How many of some answers are right."""

    right: int
    cases: int

    @classmethod
    def of(cls, answers: Iterable[Answer]) -> "Share":
        """Count."""
        listed = list(answers)
        return cls(sum(a.right for a in listed), len(listed))

    @property
    def value(self) -> float:
        """The share itself; not a number if there are none."""
        return self.right / self.cases if self.cases else float("nan")

    def __str__(self) -> str:
        return f"{self.value:.3f} ({self.right}/{self.cases})" if self.cases else "-"


def by_level(answers: Sequence[Answer]) -> dict[str, Share]:
    """Return SR of each level, of all, and how many instructions to refuse were refused."""
    good = [a for a in answers if not a.must_refuse]
    levels = {level: Share.of(a for a in good if a.level == level) for level in LEVELS}
    return {**levels, "all": Share.of(good), "refused": Share.of(a for a in answers if a.must_refuse)}


def by_voice(answers: Iterable[Answer]) -> dict[str, list[Answer]]:
    """Return the answers of each voice, in the order of their names."""
    voices: dict[str, list[Answer]] = defaultdict(list)
    for answer in answers:
        voices[answer.voice or "-"].append(answer)
    return {name: voices[name] for name in sorted(voices, key=lambda v: (len(v), v))}


def left_out(results: Iterable[Evaluation]) -> dict[str, dict[str, Share]]:
    """Return for each voice that a run left out its SR by level, and under `mean` that of all their answers."""
    found = {str(r.labels["held_out"]): r.answers for r in results if "held_out" in r.labels}
    rows = {voice: by_level(answers) for voice, answers in sorted(found.items(), key=lambda f: (len(f[0]), f[0]))}
    if rows:
        rows["mean"] = by_level([a for answers in found.values() for a in answers])
    return rows


def curve(results: Iterable[Evaluation], label: str) -> list[tuple[str, float, dict[str, Share]]]:
    """Return (run, value of the label, SR by level) of each result with that label, in rising order."""
    points = [
        (str(r.labels.get("run", "")), float(r.labels[label]), by_level(r.answers))
        for r in results
        if label in r.labels and "held_out" not in r.labels
    ]
    return sorted(points, key=lambda p: (p[0], p[1]))


def lines(head: str, rows: Iterable[tuple[str, dict[str, Share]]]) -> list[str]:
    """Return a table in Markdown."""
    columns = (*LEVELS, "all", "refused")
    return [
        f"| {head} | " + " | ".join(columns) + " |",
        "|" + " --- |" * (len(columns) + 1),
        *(f"| {name} | " + " | ".join(str(shares[c]) for c in columns) + " |" for name, shares in rows),
    ]


def report(results: Sequence[Evaluation]) -> str:
    """Return all tables that the results allow, as Markdown."""
    parts: list[str] = []
    estimates = left_out(results)
    if estimates:
        spread = statistics.pstdev([row["all"].value for voice, row in estimates.items() if voice != "mean"])
        parts += ["Each voice left out of training in turn:", "", *lines("voice", estimates.items()), ""]
        parts += [f"SR varies by {spread:.3f} (standard deviation) from one voice to another.", ""]
    for label in ("tokens", "voices"):
        points = curve(results, label)
        if points:
            rows = [(f"{run} {value:g}".strip(), shares) for run, value, shares in points]
            parts += [f"SR against {label}:", "", *lines(label, rows), ""]
    for result in results:
        voices = by_voice(result.answers)
        if "held_out" not in result.labels and len(voices) > 1:
            rows = [(name, by_level(answers)) for name, answers in voices.items()]
            parts += [f"{result.dataset}, by voice:", "", *lines("voice", rows), ""]
    return "\n".join(parts)


def draw(results: Sequence[Evaluation], target: Path) -> None:
    """Write the curves as a picture: SR by level against tokens and against voices."""
    from matplotlib.figure import Figure  # noqa: PLC0415 (only pictures need it)

    figure = Figure(figsize=(10, 4.2), layout="constrained")
    for axes, label in zip(figure.subplots(1, 2, sharey=True), ("tokens", "voices"), strict=True):
        points = curve(results, label)
        for run in sorted({run for run, _, _ in points}):
            for level in LEVELS:
                places = [(value, shares[level].value) for r, value, shares in points if r == run]
                axes.plot(*zip(*places, strict=True), marker="o", label=f"{run} {level}".strip())
        axes.set(xlabel=label, ylabel="SR", ylim=(0, 1.02))
        axes.grid(visible=True, alpha=0.3)
        if points:
            axes.legend(fontsize=7)
    figure.savefig(target, dpi=110, metadata={"Software": None})


def main() -> None:
    """Read, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", nargs="+", type=Path)
    parser.add_argument("--picture", type=Path, help="draw the curves into this file")
    options = parser.parse_args()
    results = [Evaluation.model_validate_json(path.read_bytes()) for path in options.results]
    print(report(results))
    if options.picture:
        draw(results, options.picture)


if __name__ == "__main__":
    main()
