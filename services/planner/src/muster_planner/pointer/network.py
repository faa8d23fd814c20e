"""The trained network: two ONNX files, run by onnxruntime on the processor."""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .choices import ITEM, LINES
from .reading import Reading
from .scene import ItemType, Scene

START = -1
"""What stands before the first choice."""
MOST_CHOICES = 191
"""Choices of the longest answer that the network can write."""

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Memory:
    """What was read: `inputs` and `keys` [I, W] of the items, `read` [blocks, 2, heads, L, d] keys and values."""

    inputs: Floats
    keys: Floats
    types: NDArray[np.int64]
    read: Floats


@dataclass(frozen=True)
class Written:
    """What B answers in the making have in memory.

    `past` [blocks, 2, B, heads, T, d]: keys and values; `lines` [B, LINES, W]: the state at each line's verb; `known`
    [B, LINES]: which of these are there.
    """

    past: Floats
    lines: Floats
    known: NDArray[np.bool_]

    def chosen(self, places: Sequence[int]) -> "Written":
        """Return the answers at the places, which may repeat."""
        at = np.asarray(places, dtype=np.intp)
        return Written(self.past[:, :, at], self.lines[at], self.known[at])


class Network:
    """Reads an instruction once, then scores one choice after another."""

    def __init__(self, folder: Path, threads: int) -> None:
        onnxruntime: Any = importlib.import_module("onnxruntime")  # it comes without types
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        self._reader, self._writer = (
            onnxruntime.InferenceSession(str(folder / f"{n}.onnx"), options, providers=["CPUExecutionProvider"])
            for n in ("reader", "writer")
        )
        shapes: dict[str, list[Any]] = {i.name: i.shape for i in self._writer.get_inputs()}
        self._blocks, self._heads, self._part = (int(shapes["past"][at]) for at in (0, 3, 5))
        self._width = int(shapes["line_states"][2])

    def read(self, reading: Reading, scene: Scene) -> Memory:
        """Read an instruction on a site."""
        types = np.array([int(i.type) for i in scene.items], dtype=np.int64)
        spans = np.stack((np.array(reading.starts), np.array(reading.ends)), axis=-1).astype(np.int64)
        inputs, keys, read = self._run(
            self._reader,
            ids=np.array([reading.ids], dtype=np.int64),
            types=np.array([reading.types], dtype=np.int64),
            spans=spans[None],
            item_types=types[None],
        )
        return Memory(inputs, keys, types, read)

    def nothing(self) -> Written:
        """Return the memory of one answer that has not begun."""
        return Written(
            np.zeros((self._blocks, 2, 1, self._heads, 0, self._part), np.float32),
            np.zeros((1, LINES, self._width), np.float32),
            np.zeros((1, LINES), np.bool_),
        )

    def write(
        self, memory: Memory, written: Written, choices: Sequence[int], lines: Sequence[int], scene: Scene
    ) -> tuple[Floats, Written]:
        """Take in the latest choice of each answer (and how many lines it has begun), and score what may come next.

        Returns scores [B, ITEM + I], and the memory for the next call.
        """
        scores, state, present = self._run(
            self._writer,
            choice=np.array(choices, dtype=np.int64),
            line=np.array(lines, dtype=np.int64),
            place=np.array([written.past.shape[4]], dtype=np.int64),
            past=written.past,
            line_states=written.lines,
            written=written.known,
            item_inputs=memory.inputs,
            item_keys=memory.keys,
            item_types=memory.types,
            read=memory.read,
        )
        kept, known = written.lines.copy(), written.known.copy()
        for n, (choice, line) in enumerate(zip(choices, lines, strict=True)):
            if choice >= ITEM and scene.items[choice - ITEM].type is ItemType.VERB:
                kept[n, line - 1], known[n, line - 1] = state[n], True
        return scores, Written(present, kept, known)

    @staticmethod
    def _run(session: Any, **inputs: Any) -> list[Floats]:
        return session.run(None, inputs)
