"""Instruction and scene as the encoder's tokens."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from tokenizers import Tokenizer

from .scene import Scene

MOST_TOKENS = 512
"""Places that the encoder knows."""


class TooLongError(ValueError):
    """Instruction and scene together have more tokens than the encoder can read."""


@dataclass(frozen=True)
class Reading:
    """What the encoder gets: token ids, 0 or 1 for the instruction's and the scene's, each item's first and last."""

    ids: tuple[int, ...]
    types: tuple[int, ...]
    starts: tuple[int, ...]
    ends: tuple[int, ...]


class Reader:
    """Turns texts into tokens."""

    def __init__(self, tokenizer: Path) -> None:
        self._tokenizer = Tokenizer.from_file(str(tokenizer))
        self._tokenizer.no_padding()
        self._tokenizer.no_truncation()
        self._tokenizer.encode_special_tokens = True  # marks such as [SEP] in a text are words like others
        self._begin, self._separator = self._id("[CLS]"), self._id("[SEP]")
        self._words = lru_cache(4096)(self._ids)

    def read(self, text: str, scene: Scene) -> Reading:
        """Return the tokens of an instruction on a site.

        Raises:
            TooLongError: there are too many.

        """
        said = [self._begin, *self._ids(text), self._separator]
        shown: list[int] = []
        starts: list[int] = []
        ends: list[int] = []
        for group in scene.groups:
            for item in group:
                starts.append(len(said) + len(shown))
                shown += self._words(item.words)
                ends.append(len(said) + len(shown) - 1)
            shown.append(self._separator)
        if len(said) + len(shown) > MOST_TOKENS:
            raise TooLongError(f"{len(said)} tokens of text and {len(shown)} of the site are more than {MOST_TOKENS}")
        return Reading((*said, *shown), (0,) * len(said) + (1,) * len(shown), tuple(starts), tuple(ends))

    def _id(self, token: str) -> int:
        found = self._tokenizer.token_to_id(token)
        if found is None:
            raise ValueError(f"the tokenizer lacks {token}")
        return found

    def _ids(self, text: str) -> Sequence[int]:
        return self._tokenizer.encode(text, add_special_tokens=False).ids or [self._separator]
