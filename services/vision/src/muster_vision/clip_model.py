"""The open_clip model that says how well a crop fits words.

The default is a small model trained here on rendered crops (`training/`); any other that open_clip knows takes its
place by name and weights.
"""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from .camera import Picture

SHIPPED = Path(__file__).parent / "models" / "site-clip"
BATCH = 32

Scores = npt.NDArray[np.float32]


class ModelError(ValueError):
    """The model cannot be loaded; the message says what to set."""


class ClipModel:
    """Image and text towers on one CPU thread.

    Torch and open_clip are imported with the first model, since that takes seconds: make it in a thread. Both are
    untyped here; nothing untyped leaves this class.
    """

    def __init__(self, name: str = "", pretrained: str = "") -> None:
        """Load a model.

        Args:
            name: one of open_clip's (`ViT-B-32`), or `local-dir:FOLDER` with its configuration and weights; empty: the
                shipped one.
            pretrained: path of its weights, or one of open_clip's tags (which it downloads).

        Raises:
            ModelError: no such model or weights.

        """
        self._torch: Any = importlib.import_module("torch")
        open_clip: Any = importlib.import_module("open_clip")
        self._torch.set_num_threads(1)
        known = name or f"local-dir:{SHIPPED}"
        try:
            model, self._transform = open_clip.create_model_from_pretrained(known, pretrained=pretrained or None)
            self._tokenize: Any = open_clip.get_tokenizer(known)
        except (RuntimeError, OSError, ValueError) as error:
            raise ModelError(
                f"cannot load the vision model {name or 'that ships with Muster'} "
                f"(MUSTER_VISION_MODEL, MUSTER_VISION_PRETRAINED={pretrained!r}): {error}"
            ) from error
        self._model: Any = model.eval()
        self._meanings: dict[tuple[str, ...], Any] = {}
        with self._torch.inference_mode():
            self._scale = float(model.logit_scale.exp())

    def scores(self, crops: Sequence[Picture], wordings: Sequence[Sequence[str]]) -> Scores:
        """Return how well crops fit meanings; rows add up to one.

        Args:
            crops: RGB, of any size.
            wordings: several ways to say each meaning, whose text vectors are averaged.

        Returns:
            Probabilities (len(crops), len(wordings)).

        """
        if not crops:
            return np.zeros((0, len(wordings)), np.float32)
        with self._torch.inference_mode():
            words = self._torch.stack([self._meaning(tuple(w)) for w in wordings])
            logits = self._scale * self._pictures(crops) @ words.T
            return logits.softmax(dim=-1).numpy()

    def _meaning(self, wordings: tuple[str, ...]) -> Any:
        """Return the unit text vector (width,) of what all these wordings mean; encoded once."""
        if wordings not in self._meanings:
            vectors = self._model.encode_text(self._tokenize(list(wordings)), normalize=True)
            self._meanings[wordings] = self._torch.nn.functional.normalize(vectors.mean(dim=0), dim=0)
        return self._meanings[wordings]

    def _pictures(self, crops: Sequence[Picture]) -> Any:
        """Return unit image vectors (len(crops), width)."""
        batches = (crops[start : start + BATCH] for start in range(0, len(crops), BATCH))
        return self._torch.cat(
            [
                self._model.encode_image(
                    self._torch.stack([self._transform(Image.fromarray(c)) for c in batch]), normalize=True
                )
                for batch in batches
            ]
        )
