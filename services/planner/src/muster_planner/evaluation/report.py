"""An evaluation as text: the tables in Markdown, and what went wrong case by case."""

from collections.abc import Iterable, Sequence

from .measures import Answer, Evaluation
from .paper import ABLATION_L3, REPORTED

HEAD = ("level", "cases", "SR", "IPA", "DSR", "SGSR", "RTR", "mean s", "sd s")
ABLATION_HEAD = ("level", "with dependencies", "without: queues", "without: list", "list, order only")


def table(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """Return the main table's cells, one row a level."""
    spread = evaluation.repeat > 1
    return [
        (
            row.level,
            str(row.cases),
            f"{row.sr:.3f}" + (f" ± {row.sr_spread:.3f}" if spread else ""),
            *(f"{value:.3f}" for value in (row.ipa, row.dsr, row.sgsr)),
            f"{row.rtr:.2f}",
            f"{row.mean_s:.2f}",
            f"{row.sd_s:.2f}",
        )
        for row in evaluation.rows
    ]


def ablation_table(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """Return SR with and without dependencies, one row a level."""
    return [
        (r.level, *(f"{v:.3f}" for v in (r.with_dependencies, r.queues, r.listed, r.listed_in_order)))
        for r in evaluation.ablation
    ]


def summary(evaluation: Evaluation) -> list[str]:
    """Return what stands under the tables."""
    refusals = evaluation.refusals
    lines = [f"Planning time: p50 {evaluation.p50_s:.2f} s, p95 {evaluation.p95_s:.2f} s."]
    if refusals.to_refuse:
        share = refusals.rightly_refused / refusals.to_refuse
        lines.append(
            f"Refused as they must be: {refusals.rightly_refused} of {refusals.to_refuse} instructions ({share:.1%})."
        )
    if refusals.good:
        share = refusals.wrongly_refused / refusals.good
        lines.append(f"Good instructions refused: {refusals.wrongly_refused} of {refusals.good} ({share:.1%}).")
    if not evaluation.complete:
        lines.append("Not complete: it was stopped before its last case.")
    return lines


def title(evaluation: Evaluation) -> str:
    """Return what was evaluated, in one line."""
    parts = [evaluation.dataset, f"planner {evaluation.planner}"]
    if evaluation.method != "dart-llm":
        parts.append(evaluation.method)
    if not evaluation.dependencies:
        parts.append("without dependencies (queues)")
    if evaluation.limit:
        parts.append(f"{evaluation.limit} cases drawn by chance")
    if evaluation.repeat > 1:
        parts.append(f"{evaluation.repeat} repeats")
    return ", ".join(parts)


def markdown(evaluation: Evaluation) -> str:
    """Return the tables as a page that says how it was made."""
    lines = [
        "<!-- written by `muster evaluate --out`; do not edit -->",
        f"# {title(evaluation)}",
        "",
        *_rows(HEAD, table(evaluation)),
        "",
    ]
    for line in summary(evaluation):
        lines += [line, ""]
    lines += [
        "SR with and without the plans' dependencies, the paper's ablation ([readings](../evaluation.md)):",
        "",
        *_rows(ABLATION_HEAD, ablation_table(evaluation)),
        "",
        "As the paper reports it, on 102 other instructions (its RTR has another, unpublished definition):",
        "",
        *_rows(
            ("model", *(f"{m} {level}" for level in ("L1", "L2", "L3") for m in ("SR", "IPA", "DSR", "SGSR", "RTR"))),
            [(r.model, *(f"{v:.2f}" for v in (*r.l1, *r.l2, *r.l3))) for r in REPORTED],
        ),
        "",
        "Its ablation, SR of L3: "
        + "; ".join(f"{model} {with_} with, {without} without" for model, (with_, without) in ABLATION_L3.items())
        + ".",
    ]
    wrong = evaluation.failures
    if wrong:
        lines += ["", f"Wrong: {', '.join(a.id for a in wrong)}."]
    return "\n".join(lines) + "\n"


def _rows(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    return ["| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows)]


def failure(answer: Answer) -> str:
    """Return what was wrong with one answer, in some lines."""
    lines = [
        f"{answer.id}: {answer.why}",
        f"    {' '.join(answer.text.split())}",
        *(f"    {line}" for line in answer.diff),
    ]
    if answer.error:
        lines.append(f"    said: {answer.error}")
    return "\n".join(lines)
