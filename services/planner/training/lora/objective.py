# pyright: basic
"""What training makes small: the cross entropy of the answers' tokens."""

import os
import random
from pathlib import Path

import torch
from torch.nn import functional

from training import corpus
from training.generator import mission

from .batches import Batch, Encoder, sorted_batches
from .model import Block, Planner


def vocabulary(path: Path, encoder: Encoder, seed: int) -> torch.Tensor:
    """Return ids of the tokens that answers are made of, and of those of the corpus' texts as rivals.

    Scoring all 49,152 would take a sixth of the time and teach what the grammar sees to anyway. They are kept in
    `path`, so that a run that is resumed after the corpus has grown goes on with the same ones.
    """
    if not path.exists():
        part = path.with_suffix(f".{os.getpid()}")
        torch.save(_vocabulary(encoder, seed), part)
        part.replace(path)
    return torch.load(path, weights_only=True)


def _vocabulary(encoder: Encoder, seed: int) -> torch.Tensor:
    cases = corpus.training() + corpus.held_out()
    ids = {i for c in cases for i in encoder.ids(c.text + " " + c.text.lower())}
    random_ = random.Random(seed)
    for case in cases + [mission(random_) for _ in range(2000)]:
        tokens, start, _ = encoder.row(case)
        ids |= set(tokens[start:])
    return torch.tensor(sorted(ids))


def loss_of(model: Planner, batch: Batch, encoder: Encoder, shared: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
    """Mean cross entropy over the answers' tokens of a batch."""
    device = shared.device
    hidden = model(shared, batch.rows.to(device), len(encoder.prefix), batch.alone.to(device))
    asked = batch.targets >= 0
    wanted = batch.targets[asked].to(device)
    targets = torch.searchsorted(words, wanted).clamp(max=len(words) - 1)
    targets = torch.where(words[targets] == wanted, targets, -100)
    return functional.cross_entropy(model.logits(hidden[asked.to(device)], words), targets, ignore_index=-100)


def held_out_loss(model: Planner, encoder: Encoder, shared: torch.Tensor, words: torch.Tensor, tokens: int) -> float:
    """Mean cross entropy over the held-out voices' answers."""
    model.run_block = Block.forward  # compiling for so few batches does not pay
    with torch.no_grad():
        parts = [
            (loss_of(model, b, encoder, shared, words).item(), int((b.targets >= 0).sum()))
            for b in sorted_batches(encoder, corpus.held_out(), tokens)
        ]
    return sum(a * n for a, n in parts) / sum(n for _, n in parts)
