# pyright: basic, reportArgumentType=false, reportIndexIssue=false, reportAttributeAccessIssue=false
"""The base model in torch, with a LoRA adapter on every linear layer.

The weights come from the very GGUF file that ships with the service (dequantised), in its own layout: rotary pairs are
neighbours (2i, 2i+1), so an adapter trained here fits that file without any permutation.

A batch is one shared prefix (the site's roster) of P tokens and N rows of S tokens (padded on the right). Every row
attends to the prefix and to itself only, so the prefix is paid once for N instructions.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import gguf
import numpy as np
import torch
from gguf.quants import dequantize
from torch import nn
from torch.nn import functional

LINEARS = ("attn_q", "attn_k", "attn_v", "attn_output", "ffn_gate", "ffn_up", "ffn_down")
"""Names of the adapted matrices of a block, as they stand in the GGUF file."""


@dataclass(frozen=True)
class Shape:
    """Sizes of the base model; `eps` is the RMS norm's, `theta` the rotary base."""

    layers: int
    width: int
    heads: int
    kv_heads: int
    eps: float
    theta: float

    @property
    def head_width(self) -> int:
        """Numbers per attention head."""
        return self.width // self.heads


class LoraLinear(torch.autograd.Function):
    """y = x W' + s (x A') B' for frozen W; x is [T, in], W [out, in], A [r, in], B [out, r], all bf16."""

    @staticmethod
    def forward(ctx, x, weight, a, b, scale):  # noqa: D102
        low = x @ a.t()
        y = x @ weight.t()
        y.addmm_(low, b.t(), alpha=scale)
        ctx.save_for_backward(x, weight, a, b, low)
        ctx.scale = scale
        return y

    @staticmethod
    def backward(ctx, grad):  # noqa: D102
        x, weight, a, b, low = ctx.saved_tensors
        grad_low = (grad @ b) * ctx.scale
        dx = grad @ weight
        dx.addmm_(grad_low, a)
        da = grad_low.t() @ x
        db = (grad.t() @ low) * ctx.scale
        return dx, None, da, db, None


def rotate(x: torch.Tensor, cos: torch.Tensor, sin: torch.Tensor) -> torch.Tensor:
    """Rotary positions on neighbouring pairs; x is [T, heads, d], cos and sin [T, 1, d/2]."""
    even, odd = x[..., 0::2], x[..., 1::2]
    return torch.stack((even * cos - odd * sin, odd * cos + even * sin), dim=-1).flatten(-2)


def rms(x: torch.Tensor, weight: torch.Tensor, eps: float) -> torch.Tensor:
    """RMS norm in fp32, answered in x's type."""
    wide = x.float()
    return (wide * torch.rsqrt(wide.pow(2).mean(-1, keepdim=True) + eps) * weight).to(x.dtype)


class Block(nn.Module):
    """One transformer block: frozen matrices as buffers, adapter matrices as fp32 parameters."""

    def __init__(self, shape: Shape, weights: dict[str, torch.Tensor], rank: int, scale: float) -> None:
        super().__init__()
        self.shape, self.scale = shape, scale
        self.register_buffer("attn_norm", weights["attn_norm"].float())
        self.register_buffer("ffn_norm", weights["ffn_norm"].float())
        self.a, self.b = nn.ParameterDict(), nn.ParameterDict()
        for name in LINEARS:
            weight = weights[name].to(torch.bfloat16).contiguous()
            self.register_buffer(f"w_{name}", weight)
            out, into = weight.shape
            self.a[name] = nn.Parameter(torch.empty(rank, into).normal_(0.0, 1.0 / math.sqrt(into)))
            self.b[name] = nn.Parameter(torch.zeros(out, rank))

    def linear(self, x: torch.Tensor, name: str) -> torch.Tensor:
        """Apply the adapted matrix `name` to x [T, in]."""
        a, b = self.a[name].to(x.dtype), self.b[name].to(x.dtype)
        return LoraLinear.apply(x, getattr(self, f"w_{name}"), a, b, self.scale)

    def attention(self, x, layout: tuple[int, int, int], angles, mask):
        """Map x [T, width] normed -> [T, width]; T = prefix + rows * width, additive masks."""
        (prefix, rows, width), (cos, sin), s = layout, angles, self.shape
        d, group = s.head_width, s.heads // s.kv_heads
        q = rotate(self.linear(x, "attn_q").view(-1, s.heads, d), cos, sin) / math.sqrt(d)
        k = rotate(self.linear(x, "attn_k").view(-1, s.kv_heads, d), cos, sin)
        v = self.linear(x, "attn_v").view(-1, s.kv_heads, d)

        def attend(query, keys, values, bias):
            scores = query @ keys.transpose(-1, -2)
            n, h, rows_, cols = scores.shape
            scores = scores.view(n, h, group, rows_ // group, cols) + bias
            return torch.softmax(scores, dim=-1).view(n, h, rows_, cols) @ values

        def queries(t, n: int, length: int):
            grouped = t.view(n, length, s.kv_heads, group, d).permute(0, 2, 3, 1, 4)
            return grouped.reshape(n, s.kv_heads, group * length, d)

        def back(t, n: int, length: int):
            t = t.view(n, s.kv_heads, group, length, d).permute(0, 3, 1, 2, 4)
            return t.reshape(n * length, s.width)

        kp, vp = (t[:prefix].transpose(0, 1).unsqueeze(0) for t in (k, v))
        head = back(attend(queries(q[:prefix], 1, prefix), kp, vp, mask[0]), 1, prefix)
        kr, vr = (t[prefix:].view(rows, width, s.kv_heads, d).transpose(1, 2) for t in (k, v))
        keys = torch.cat((kp.expand(rows, -1, -1, -1), kr), dim=2)
        values = torch.cat((vp.expand(rows, -1, -1, -1), vr), dim=2)
        body = back(attend(queries(q[prefix:], rows, width), keys, values, mask[1]), rows, width)
        return self.linear(torch.cat((head, body)), "attn_output")

    def forward(self, x, layout: tuple[int, int, int], angles, mask):
        """One block over the flat tokens x [T, model width]."""
        x = x + self.attention(rms(x, self.attn_norm, self.shape.eps), layout, angles, mask)
        y = rms(x, self.ffn_norm, self.shape.eps)
        gate = functional.silu(self.linear(y, "ffn_gate")) * self.linear(y, "ffn_up")
        return x + self.linear(gate, "ffn_down")


class Planner(nn.Module):
    """The whole model. `forward` gives the final hidden states; `logits` scores a part of the vocabulary."""

    def __init__(self, path: Path, rank: int, alpha: float) -> None:
        super().__init__()
        reader = gguf.GGUFReader(str(path))
        field = {k: f.contents() for k, f in reader.fields.items() if k.startswith("llama.")}
        self.shape = Shape(
            layers=field["llama.block_count"],
            width=field["llama.embedding_length"],
            heads=field["llama.attention.head_count"],
            kv_heads=field["llama.attention.head_count_kv"],
            eps=field["llama.attention.layer_norm_rms_epsilon"],
            theta=field["llama.rope.freq_base"],
        )
        self.rank, self.alpha = rank, alpha
        self.run_block = Block.forward
        tensors = {t.name.removesuffix(".weight"): t for t in reader.tensors}

        def load(name: str) -> torch.Tensor:
            t = tensors[name]
            return torch.from_numpy(np.array(dequantize(t.data, t.tensor_type), dtype=np.float32))

        self.register_buffer("embedding", load("token_embd").to(torch.bfloat16))
        self.register_buffer("output_norm", load("output_norm"))
        names = (*LINEARS, "attn_norm", "ffn_norm")
        self.blocks = nn.ModuleList(
            Block(self.shape, {n: load(f"blk.{i}.{n}") for n in names}, rank, alpha / rank)
            for i in range(self.shape.layers)
        )

    def forward(self, prefix: torch.Tensor, rows: torch.Tensor, used: int, alone: torch.Tensor) -> torch.Tensor:
        """Hidden states [N, S, width], normed, for a prefix [P] and rows [N, S] of token ids.

        The first `used` tokens of the prefix count; the rest of it is padding that nobody sees, so that all batches
        have one shape and compiled code is used again. Rows with `alone` [N] set bring a prefix of their own and do
        not see the shared one.
        """
        p, (n, width) = len(prefix), rows.shape
        device = rows.device
        starts = torch.where(alone, 0, used).unsqueeze(1) + torch.arange(width, device=device)
        position = torch.cat((torch.arange(p, device=device), starts.flatten()))
        d = self.shape.head_width
        inverse = self.shape.theta ** (-torch.arange(0, d, 2, device=device, dtype=torch.float64) / d)
        angle = position.double().unsqueeze(1) * inverse
        x = functional.embedding(torch.cat((prefix, rows.reshape(-1))), self.embedding)
        angles = tuple(f(angle).to(x.dtype).unsqueeze(1) for f in (torch.cos, torch.sin))
        causal = torch.full((width, width), -1e9, device=device).triu(1)
        hidden = (torch.arange(p, device=device) >= used) | alone.unsqueeze(1)
        hidden = torch.where(hidden, -1e9, 0.0).view(n, 1, 1, 1, p).expand(n, 1, 1, width, p)
        mask = (
            torch.full((p, p), -1e9, device=device).triu(1).to(x.dtype),
            torch.cat((hidden, causal.expand(n, 1, 1, width, width)), dim=-1).to(x.dtype),
        )
        for block in self.blocks:
            x = self.run_block(block, x, (p, n, width), angles, mask)
        return rms(x[p:], self.output_norm, self.shape.eps).view(n, width, -1)

    def compile(self) -> None:
        """Compile one block's code; it serves all blocks; each new (P, N, S) compiles once (half a minute)."""
        torch._dynamo.config.recompile_limit = 64
        self.run_block = torch.compile(Block.forward, dynamic=False)

    def logits(self, hidden: torch.Tensor, vocabulary: torch.Tensor) -> torch.Tensor:
        """Scores [K, len(vocabulary)] of hidden [K, width] for a part of the vocabulary, fp32."""
        return (hidden @ self.embedding[vocabulary].t()).float()

    def adapter(self) -> Iterator[tuple[str, torch.Tensor, torch.Tensor]]:
        """(name of the GGUF tensor, A [r, in], B [out, r]) of every adapted matrix."""
        for i, block in enumerate(self.blocks):
            for name in LINEARS:
                yield f"blk.{i}.{name}.weight", block.a[name], block.b[name]
