# pyright: basic
"""One run of training: its state on disk, its steps, and the processes that share them."""

import os
import random
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import distributed

from training import corpus
from training.generator import mission

from .batches import Batch, Encoder, stream
from .model import Planner
from .objective import held_out_loss, loss_of, vocabulary

SAVE_EVERY_S = 180
READ_EVERY = 60
"""Steps between readings of the corpus."""


@dataclass(frozen=True)
class Options:
    """What a run is made of; see `train.py` for the command line that fills it."""

    folder: Path
    base: Path
    minutes: float
    rate: float
    rank: int
    tokens: int
    seed: int
    all_voices: bool
    processes: int
    threads: int
    meeting: str


def work(place: int, options: Options) -> None:
    """Train until the minutes are over, as process number `place` of those that average their gradients.

    Processes of one thread each meet once a step; one process of several threads would meet at every operation, and
    on a machine that others use as well, each meeting waits for the slowest. Each leads a session of its own, because
    Linux shares processors out by session; when the starting process ends, so do they.
    """
    parent = os.getppid()
    if options.processes > 1:
        os.setsid()
        distributed.init_process_group("gloo", init_method=options.meeting, rank=place, world_size=options.processes)
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)
    run = Run(place, options)
    while not run.over and (options.processes == 1 or os.getppid() == parent):
        run.step()
    if place == 0:
        run.save()
        run.say(f"held-out loss {run.held_out_loss():.4f}")


class Run:
    """A model in training."""

    def __init__(self, place: int, options: Options) -> None:
        self.place, self.options = place, options
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self.encoder = Encoder(options.base)
        self.model = Planner(options.base, options.rank, options.rank).to(self.device)
        self.model.compile()
        self.words = vocabulary(options.folder / "vocabulary.pt", self.encoder, options.seed).to(self.device)
        self.shared = self.encoder.shared().to(self.device)
        self.weights = [p for p in self.model.parameters() if p.requires_grad]
        self.optimizer = torch.optim.AdamW(
            self.weights, lr=options.rate, betas=(0.9, 0.98), weight_decay=0.0, fused=True
        )
        self.steps, self.trained_s = 0, 0.0
        self.checkpoint = options.folder / "checkpoint.pt"
        if self.checkpoint.exists():
            state = torch.load(self.checkpoint, map_location=self.device, weights_only=True)
            self.model.load_state_dict(state["model"], strict=False)
            self.optimizer.load_state_dict(state["optimizer"])
            self.steps, self.trained_s = state["step"], state["trained"]
        self.batches = self._read()
        self._saved = time.monotonic()
        self._mean: float | None = None

    @property
    def over(self) -> bool:
        """Tell whether the minutes that were asked for are over."""
        return self.trained_s >= self.options.minutes * 60

    def step(self) -> None:
        """Do one step: a batch in every process, one change of the weights."""
        start = time.monotonic()
        for group in self.optimizer.param_groups:
            done = self.trained_s / (self.options.minutes * 60)
            group["lr"] = self.options.rate * min(1.0, (self.steps + 1) / 40) * max(0.02, 1.0 - done)
        loss = loss_of(self.model, next(self.batches), self.encoder, self.shared, self.words)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        spent = min(time.monotonic() - start, 30.0)  # a longer step was compilation
        spent, average = self._together([spent, loss.item()])
        torch.nn.utils.clip_grad_norm_(self.weights, 1.0)
        self.optimizer.step()
        self.steps += 1
        self.trained_s += spent
        self._mean = average if self._mean is None else 0.95 * self._mean + 0.05 * average
        if self.steps % 10 == 0:
            self.say(
                f"trained {self.trained_s / 60:.1f} min loss {average:.3f} mean {self._mean:.3f} step {spent:.1f} s"
            )
        if self.steps % READ_EVERY == 0:
            # Read again, so that a resumed run sees what an uninterrupted one sees
            self.batches = self._read()
        if self.place == 0 and time.monotonic() - self._saved > SAVE_EVERY_S:
            self.save()
            self._saved = time.monotonic()

    def save(self) -> None:
        """Write the checkpoint; a stop in between leaves the one before."""
        state = {
            "model": {n: p.detach() for n, p in self.model.named_parameters()},
            "optimizer": self.optimizer.state_dict(),
            "step": self.steps,
            "trained": self.trained_s,
            "rank": self.options.rank,
            "alpha": self.model.alpha,
        }
        part = self.checkpoint.with_suffix(".part")
        torch.save(state, part)
        part.replace(self.checkpoint)

    def say(self, text: str) -> None:
        """Print a line of progress, from one process only."""
        if self.place == 0:
            print(f"{time.strftime('%H:%M:%S')} step {self.steps} {text}", flush=True)

    def held_out_loss(self) -> float:
        """Return the loss on the held-out voices; ends training, since it puts the compiled code aside."""
        return held_out_loss(self.model, self.encoder, self.shared, self.words, self.options.tokens)

    def _read(self) -> Iterator[Batch]:
        cases = corpus.training() + (corpus.held_out() if self.options.all_voices else [])
        count = sum(w.numel() for w in self.weights) / 1e6
        self.say(f"{len(cases)} cases, {len(self.words)} words, {count:.1f} M weights")
        seed = f"{self.options.seed}/{self.steps}/{self.place}"
        return stream(self.encoder, cases, mission, self.options.tokens, random.Random(seed))

    def _together(self, numbers: list[float]) -> list[float]:
        """Average all processes' gradients (in place) and `numbers`, which come back."""
        if self.options.processes == 1:
            return numbers
        grads = [w.grad for w in self.weights if w.grad is not None]
        flat = torch.cat([g.flatten() for g in grads] + [torch.tensor(numbers, device=self.device)])
        distributed.all_reduce(flat)
        flat /= self.options.processes
        at = 0
        for grad in grads:
            grad.copy_(flat[at : at + grad.numel()].view_as(grad))
            at += grad.numel()
        return flat[at:].tolist()
