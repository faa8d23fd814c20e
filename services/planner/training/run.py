# pyright: basic, reportCallIssue=false, reportArgumentType=false, reportPrivateImportUsage=false
"""One training run of the pointer model: resumable, seeded, several processes that average their gradients."""

import copy
import os
import random
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from muster_planner.pointer.reading import Reader
from torch import distributed
from torch.nn import functional

from . import corpus
from .batches import Rows, draws, stream
from .generator import mission
from .model import Batch, PointerModel

SAVE_EVERY_S = 120
READ_EVERY = 400
"""Steps between readings of the corpus."""
KEPT = 0.9985
"""Of the average of weights, a step."""
FALL = 0.3
"""The share of the time in which the rate falls to nothing."""


@dataclass(frozen=True)
class Options:
    """What a run is made of; see `train.py` for the command line that fills it."""

    folder: Path
    base: Path
    minutes: float
    rate: float
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


class Run:
    """A model in training."""

    def __init__(self, place: int, options: Options) -> None:
        self.place, self.options = place, options
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self.rows = Rows(Reader(options.base / "tokenizer.json"))
        self.model = PointerModel()
        self.model.encoder.load(options.base / "model.safetensors")
        self.model.to(self.device).train()
        self.average = copy.deepcopy(self.model).requires_grad_(requires_grad=False)
        encoder = {id(p) for p in self.model.encoder.parameters()}
        self.weights = list(self.model.parameters())
        self.optimizer = torch.optim.AdamW(
            [
                {"params": [p for p in self.weights if id(p) in encoder], "share": 0.3},
                {"params": [p for p in self.weights if id(p) not in encoder], "share": 1.0},
            ],
            lr=options.rate,
            betas=(0.9, 0.98),
            weight_decay=0.01,
            fused=True,
        )
        self.steps, self.cases, self.trained_s = 0, 0, 0.0
        self.checkpoint = options.folder / "checkpoint.pt"
        if self.checkpoint.exists():
            state = torch.load(self.checkpoint, map_location=self.device, weights_only=True)
            self.model.load_state_dict(state["model"])
            self.average.load_state_dict(state["average"])
            self.optimizer.load_state_dict(state["optimizer"])
            self.steps, self.cases, self.trained_s = state["step"], state["cases"], state["trained"]
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
        done = self.trained_s / (self.options.minutes * 60)
        for group in self.optimizer.param_groups:
            falling = min(1.0, max(0.01, (1.0 - done) / FALL))
            group["lr"] = self.options.rate * group["share"] * min(1.0, (self.steps + 1) / 200) * falling
        batch = next(self.batches)
        loss = self._loss(batch)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        average, cases = self._together([loss.item(), float(len(batch.ids))])
        torch.nn.utils.clip_grad_norm_(self.weights, 1.0)
        self.optimizer.step()
        kept = min(KEPT, self.steps / (self.steps + 10))
        with torch.no_grad():
            torch._foreach_lerp_(list(self.average.parameters()), self.weights, 1 - kept)
        self.steps += 1
        self.cases += round(cases * self.options.processes)
        (spent,) = self._agreed([time.monotonic() - start])
        self.trained_s += spent
        self._mean = average if self._mean is None else 0.98 * self._mean + 0.02 * average
        if self.steps % 50 == 0:
            self.say(f"trained {self.trained_s / 60:.1f} min, {self.cases} cases, loss {self._mean:.4f}, {spent:.2f} s")
        if self.steps % READ_EVERY == 0:
            self.batches = self._read()
        if self.place == 0 and time.monotonic() - self._saved > SAVE_EVERY_S:
            self.save()
            self._saved = time.monotonic()

    def _loss(self, batch: Batch) -> torch.Tensor:
        batch = Batch(*(getattr(batch, f).to(self.device) for f in Batch.__dataclass_fields__))
        with torch.autocast(self.device.type, torch.bfloat16):
            scores = self.model(batch)
        return functional.cross_entropy(scores.flatten(0, 1), batch.targets.flatten(), ignore_index=-100)

    def save(self) -> None:
        """Write the checkpoint; a stop in between leaves the one before."""
        state = {
            "model": self.model.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "step": self.steps,
            "cases": self.cases,
            "trained": self.trained_s,
        }
        part = self.checkpoint.with_suffix(".part")
        torch.save(state, part)
        part.replace(self.checkpoint)

    def say(self, text: str) -> None:
        """Print a line of progress, from one process only."""
        if self.place == 0:
            print(f"{time.strftime('%H:%M:%S')} step {self.steps} {text}", flush=True)

    def _read(self) -> Iterator[Batch]:
        cases = corpus.training() + (corpus.held_out() if self.options.all_voices else [])
        self.say(f"{len(cases)} cases to draw from")
        random_ = random.Random(f"{self.options.seed}/{self.steps}/{self.place}")
        return stream(self.rows, draws(cases, mission, random_), self.options.tokens)

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

    def _agreed(self, numbers: list[float]) -> list[float]:
        """Return the first process' numbers, so that all end at the same step."""
        if self.options.processes == 1:
            return numbers
        told = torch.tensor(numbers, dtype=torch.float64)
        distributed.broadcast(told, 0)
        return told.tolist()
