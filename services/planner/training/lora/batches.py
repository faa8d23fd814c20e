# pyright: basic
"""An endless stream of batches: cases drawn and varied by chance (seeded), sorted into widths."""

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from transformers import AutoTokenizer

from training.augment import Case, varied
from training.joining import joined
from training.notation import compact
from training.sites import YARD, prefix, question

PREFIX = 80
"""Tokens that the shared prefix is padded to."""
WIDTHS = (72, 112, 176, 288)
"""Widths of rows in tokens; a case goes into the narrowest that holds it."""
END = "<|im_end|>"


@dataclass(frozen=True)
class Batch:
    """`rows` [N, S] token ids, `targets` [N, S] the next token where the answer is and -1 elsewhere, `alone` [N]."""

    rows: torch.Tensor
    targets: torch.Tensor
    alone: torch.Tensor


class Encoder:
    """Turns cases into rows of tokens."""

    def __init__(self, base: Path) -> None:
        self.tokenizer = AutoTokenizer.from_pretrained(str(base.parent), gguf_file=base.name)
        self.yard = YARD
        self.prefix = self.ids(prefix(self.yard))
        if len(self.prefix) > PREFIX:
            raise ValueError(f"the yard's prefix has {len(self.prefix)} tokens, more than {PREFIX}")

    def ids(self, text: str) -> list[int]:
        """Token ids of the text; special tokens in it are read as such."""
        return self.tokenizer(text, add_special_tokens=False)["input_ids"]

    def shared(self) -> torch.Tensor:
        """Return the yard's prefix, padded to [PREFIX]."""
        return torch.tensor(self.prefix + [0] * (PREFIX - len(self.prefix)))

    def row(self, case: Case) -> tuple[list[int], int, bool]:
        """(tokens, where the answer starts, whether the row brings its own prefix)."""
        alone = case.site != self.yard
        ask = (prefix(case.site) if alone else "") + question(case.text)
        asked, answer = self.ids(ask), self.ids(compact(case.answer) + END)
        return asked + answer, len(asked), alone

    def batch(self, rows: Sequence[tuple[list[int], int, bool]], width: int, count: int) -> Batch:
        """Pad the rows to `width` and their number to `count` (empty rows teach nothing)."""
        ids = torch.zeros(count, width, dtype=torch.long)
        targets = torch.full((count, width), -1, dtype=torch.long)
        alone = torch.zeros(count, dtype=torch.bool)
        for n, (tokens, start, own) in enumerate(rows):
            ids[n, : len(tokens)] = torch.tensor(tokens)
            targets[n, start - 1 : len(tokens) - 1] = torch.tensor(tokens[start:])
            alone[n] = own
        return Batch(ids, targets, alone)


def sorted_batches(encoder: Encoder, cases: Sequence[Case], tokens: int) -> Iterator[Batch]:
    """Every case once, in batches of about `tokens` tokens."""
    waiting: dict[int, list] = {w: [] for w in WIDTHS}
    for case in cases:
        row = encoder.row(case)
        width = next((w for w in WIDTHS if len(row[0]) <= w), None)
        if width is not None:
            waiting[width].append(row)
    for width, rows in waiting.items():
        count = tokens // width
        for start in range(0, len(rows), count):
            yield encoder.batch(rows[start : start + count], width, count)


def weighted(cases: Sequence[Case], level3: float) -> Callable[[random.Random], Case]:
    """Return a way to draw cases in which those of level L3 are drawn `level3` times as often."""
    weights = [level3 if c.level == "L3" else 1.0 for c in cases]
    total: list[float] = []
    for w in weights:
        total.append(w + (total[-1] if total else 0.0))
    return lambda random_: random_.choices(cases, cum_weights=total)[0]


def stream(
    encoder: Encoder,
    cases: Sequence[Case],
    made: Callable[[random.Random], Case] | None,
    tokens: int,
    random_: random.Random,
) -> Iterator[Batch]:
    """Batches without end: 70 % varied hand-written cases, 14 % joined ones, 16 % from the generator `made`."""
    draw = weighted(cases, 1.6)
    waiting: dict[int, list] = {w: [] for w in WIDTHS}
    while True:
        chance = random_.random()
        if chance < 0.14:
            case = None
            while case is None:
                case = joined(random_.choice(cases), random_.choice(cases), random_)
            case = varied(case, random_, 0.4)
        elif chance < 0.30 and made is not None:
            case = varied(made(random_), random_, 0.5)
        else:
            case = varied(draw(random_), random_)
        row = encoder.row(case)
        width = next((w for w in WIDTHS if len(row[0]) <= w), None)
        if width is None:
            continue
        waiting[width].append(row)
        count = tokens // width
        if len(waiting[width]) == count:
            yield encoder.batch(waiting[width], width, count)
            waiting[width] = []
