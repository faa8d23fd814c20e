# pyright: basic
"""How often a model in training plans right: `muster evaluate` for files of the corpus and a model that is not shipped.

    python -m training.evaluate                           the shipped model on the held-out voices
    python -m training.evaluate --model FOLDER --limit 60 --failures data/voice7.jsonl
    python -m training.evaluate --out first.json --label tokens=2000000 --label voices=65 development.jsonl

It runs the very adapter class of the service on the default site, one instruction at a time. What `--out` keeps is what
`training.by_voice` reads.
"""

import argparse
import asyncio
import resource
from pathlib import Path

from muster_planner import embedded
from muster_planner.evaluation import measures, report
from muster_planner.evaluation.cases import read_cases
from muster_planner.evaluation.running import Judge, chosen
from muster_planner.offline import OfflinePlanner
from muster_planner.surroundings import Surroundings
from muster_schemas.site import load_site

from .corpus import DATA, HELD_OUT

SITE = Path(__file__).resolve().parents[3] / "sites" / "yard.yaml"


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, help="data sets; the held-out voices if left out")
    parser.add_argument("--model", type=Path, help="folder with another model than the shipped one")
    parser.add_argument("--limit", type=int, help="so many cases at most, drawn by chance (seeded)")
    parser.add_argument("--failures", action="store_true", help="print what went wrong")
    parser.add_argument("--threads", type=int, default=embedded.THREADS)
    parser.add_argument("--out", type=Path, help="keep the result in this file")
    parser.add_argument("--label", action="append", default=[], metavar="NAME=VALUE", help="kept in the result")
    return parser.parse_args()


def labels(said: list[str]) -> dict[str, str | float]:
    """Return what `--label` says; numbers as numbers."""
    found: dict[str, str | float] = {}
    for text in said:
        name, _, value = text.partition("=")
        try:
            found[name] = float(value)
        except ValueError:
            found[name] = value
    return found


def evaluate(options: argparse.Namespace) -> measures.Evaluation:
    """Plan every case and return how right it was."""
    files = options.files or [DATA / f"{name}.jsonl" for name in HELD_OUT]
    site = load_site(SITE)
    there = Surroundings.of_file(site)
    cases = chosen([case for file in files for case in read_cases(file, there)], options.limit)
    with asyncio.Runner() as runner:
        opened = embedded.open_embedded(threads=options.threads, folder=options.model)
        model = runner.run(opened.__aenter__())
        try:
            answers = list(Judge(there).answers(cases, OfflinePlanner(model, site, runner)))
        finally:
            runner.run(opened.__aexit__(None, None, None))
    return measures.summarise(
        answers,
        dataset=" ".join(f.name for f in files),
        planner="embedded",
        method="dart-llm",
        dependencies=True,
        repeat=1,
        complete=True,
        labels=labels(options.label),
    )


def main() -> None:
    """Evaluate, print, keep."""
    options = arguments()
    result = evaluate(options)
    if options.failures:
        for answer in result.failures:
            print(report.failure(answer))
    for line in (report.HEAD, *report.table(result)):
        print("".join(f"{cell:>9}" for cell in line))
    print("\n".join(report.summary(result)))
    print(f"Memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB.")
    if options.out:
        options.out.write_text(result.model_dump_json(indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
