"""llama.cpp with the base model and the adapter: one completion at a time, under a grammar, stopped when asked."""

import importlib
import os
import secrets
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CONTEXT = 4096
"""Tokens of prompt and answer together."""


@dataclass(frozen=True)
class Completion:
    """What the model wrote, and how many tokens it read (those kept from before apart) and wrote."""

    text: str
    finished: bool
    """Whether it came to its end; else it was stopped or reached its token limit."""
    tokens_in: int
    tokens_out: int


class Engine:
    """The loaded model. Its calls block; they must not overlap."""

    def __init__(self, base: Path, adapter: Path, threads: int) -> None:
        # Read when the library starts its threads: idle ones must sleep, or busy neighbours slow each other manyfold
        os.environ.setdefault("OMP_WAIT_POLICY", "passive")
        llama: Any = importlib.import_module("xllamacpp")
        params = llama.CommonParams()
        params.model.path = str(base)
        params.lora_adapters = [llama.CommonAdapterLoraInfo(str(adapter), 1.0)]
        params.n_ctx = CONTEXT
        params.n_parallel = 1
        params.n_gpu_layers = 0
        params.cpuparams.n_threads = threads
        params.cpuparams_batch.n_threads = threads
        params.cache_ram_mib = 0
        params.verbosity = -1
        # The library also listens on a loopback port of its own, which nobody here uses: closed but for a secret
        params.api_keys = [secrets.token_urlsafe(32)]
        params.ui = False
        params.endpoint_slots = False
        params.endpoint_props = False
        self._server: Any = llama.Server(params)

    def complete(
        self, prompt: str, grammar: str, *, max_tokens: int, temperature: float, seed: int, stop: threading.Event
    ) -> Completion:
        """Write an answer; `stop` is looked at after every token.

        What the prompt has in common with the one before is not evaluated again.
        """
        if stop.is_set():
            return Completion("", finished=False, tokens_in=0, tokens_out=0)
        answer = _Answer(stop)
        body = {
            "prompt": prompt,
            "grammar": grammar,
            "max_tokens": max_tokens,
            "temperature": temperature,
            "seed": seed,
            "cache_prompt": True,
            "stream": True,
            "stream_options": {"include_usage": True},
        }
        self._server.handle_completions(body, answer.take)
        return answer.whole()


class _Answer:
    """Puts the pieces of a streamed completion together."""

    def __init__(self, stop: threading.Event) -> None:
        self._stop = stop
        self._pieces: list[str] = []
        self._finished = False
        self._usage: dict[str, Any] = {}

    def take(self, chunk: dict[str, Any]) -> bool:
        """Add one chunk; return whether to stop."""
        for choice in chunk.get("choices") or ():
            self._pieces.append(choice.get("text") or "")
            self._finished = self._finished or choice.get("finish_reason") == "stop"
        self._usage = chunk.get("usage") or self._usage
        return self._stop.is_set()

    def whole(self) -> Completion:
        """Return what came."""
        details: dict[str, Any] = self._usage.get("prompt_tokens_details") or {}
        read = int(self._usage.get("prompt_tokens") or 0) - int(details.get("cached_tokens") or 0)
        written = int(self._usage.get("completion_tokens") or len(self._pieces))
        return Completion("".join(self._pieces), self._finished, max(read, 0), written)
