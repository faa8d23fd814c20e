"""`python -m tests.simulation SEED [COUNT]`: run a seed again, or many, and print the shortest history of a failure."""

import sys
import time

from .run import run, shortest


def main() -> int:
    """Return 1 if a seed failed."""
    first = int(sys.argv[1])
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    began, failed = time.perf_counter(), 0
    for seed in range(first, first + count):
        result = run(seed)
        if result.problems:
            failed += 1
            sys.stdout.write(f"seed {seed}: {result.problems[0][:300]}\n")
            if count == 1 or "-v" in sys.argv:
                sys.stdout.write(shortest(result).report() + "\n")
        elif count == 1:
            sys.stdout.write(result.report() + "\n")
        sys.stdout.flush()
    sys.stdout.write(f"{count} seeds, {failed} failed, {time.perf_counter() - began:.1f} s\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
