# pyright: basic
"""How often the embedded model plans right, on the held-out voices or on any file of corpus lines.

    python -m training.evaluate                           the shipped adapter on the held-out voices
    python -m training.evaluate --adapter X.gguf --limit 60 --failures data/voice7.jsonl

It runs the very adapter class of the service on the default site, one instruction at a time.
"""

import argparse
import asyncio
import json
import random
import resource
import statistics
from collections import defaultdict
from pathlib import Path

from muster_planner import embedded, embedded_files
from muster_planner.errors import AnswerError
from muster_planner.plan_language import encode
from muster_planner.short_names import SiteNames
from muster_planner.surroundings import Surroundings
from muster_schemas.site import load_site

from .corpus import DATA, HELD_OUT
from .notation import Refusal, parse, parse_compact
from .scoring import is_right

SITE = Path(__file__).resolve().parents[3] / "sites" / "yard.yaml"


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, help="corpus files; the held-out voices if left out")
    parser.add_argument("--adapter", type=Path, help="another adapter than the shipped one")
    parser.add_argument("--limit", type=int, help="so many cases at most, drawn by chance (seeded)")
    parser.add_argument("--failures", action="store_true", help="print what went wrong")
    parser.add_argument("--threads", type=int, default=embedded.THREADS)
    return parser.parse_args()


async def evaluate(options: argparse.Namespace) -> None:
    """Plan every case and print SR by level, refusals apart, and the times."""
    files = options.files or [DATA / f"{name}.jsonl" for name in HELD_OUT]
    rows = [json.loads(line) for f in files for line in f.read_text(encoding="utf-8").splitlines() if line.strip()]
    if options.limit:
        rows = random.Random(1).sample(rows, min(options.limit, len(rows)))
    if options.adapter:
        embedded_files.ADAPTER = options.adapter
    there = Surroundings.of_file(load_site(SITE))
    names = SiteNames(there.roster, there.objects, there.catalogue, there.letters)
    right: dict[str, list[bool]] = defaultdict(list)
    times: list[float] = []
    async with embedded.open_embedded(threads=options.threads) as model:
        for row in rows:
            expected = parse(row["plan"])
            refused = isinstance(expected, Refusal)
            try:
                draft = await model.plan(there.request(row["text"], None, timeout_s=300, max_tokens=2000))
                said, ok = draft.raw, draft.plan is None if refused else False
                times.append(draft.latency_s)
                if draft.plan is not None and not refused:
                    steps = parse_compact(encode(draft.plan, names))
                    ok = is_right(expected, steps)
            except AnswerError as error:
                said, ok = f"{error}", False
            right["refuse" if refused else row["level"]].append(ok)
            if options.failures and not ok:
                print(f"- {row['text']}\n  expected {row['plan']}\n  said     {said.replace(chr(10), ' | ')}")
    for level in sorted(right):
        print(f"{level:7} {len(right[level]):4} SR {statistics.mean(right[level]):.3f}")
    everything = [ok for oks in right.values() for ok in oks]
    print(f"all     {len(everything):4} SR {statistics.mean(everything):.3f}")
    times.sort()
    print(f"planning time mean {statistics.mean(times):.2f} s, p95 {times[int(len(times) * 0.95)]:.2f} s")
    print(f"memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    asyncio.run(evaluate(arguments()))
