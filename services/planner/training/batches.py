# pyright: basic
"""Cases as batches of the pointer model."""

import random
from collections.abc import Callable, Iterator, Sequence

import torch
from muster_planner.pointer.choices import ITEM, LINES, REFUSALS, REFUSE, choices_of
from muster_planner.pointer.reading import Reader, TooLongError
from muster_planner.pointer.scene import ItemType, Scene, SceneKind

from .augment import Case, varied
from .joining import joined
from .model import MOST_CHOICES, Batch
from .notation import Refusal
from .sites import Site

_REASONS = (
    ("hijack", ("attempt", "change the task", "asks to change", "ignore", "prompt")),
    ("circular", ("circular", "wait for", "waits for", "each other", "deadlock")),
    (
        "absent",
        (
            "there is no",
            "there are no",
            "there are only",
            "only three",
            "there is only",
            "is not here",
            "not on this site",
            "does not exist",
            "here has no",
            "no such",
            "not here",
            "is no ",
        ),
    ),
    (
        "unclear",
        ("does not say", "not say", "unclear", "which", "ambig", "says neither", "who ", "missing", "contradict"),
    ),
    (
        "unable",
        (
            "not a skill",
            "cannot",
            "can not",
            "has no",
            "not skills",
            "skill",
            "no robot here can",
            "nobody here",
            "not able",
            "can't",
        ),
    ),
)


def reason_of(text: str) -> str:
    """Return which of `REFUSALS` a reason in a corpus belongs to."""
    return next((r for r, words in _REASONS if any(w in text.lower() for w in words)), "nothing")


def scene_of(site: Site) -> Scene:
    """Return a training site as the model sees it."""
    kinds = (SceneKind(k.words, k.letter, tuple(f"{k.letter}{n}" for n in k.numbers), k.verbs) for k in site.kinds)
    return Scene(tuple(kinds), site.common, site.objects)


class Row:
    """One case as numbers."""

    def __init__(self, case: Case, reader: Reader, scene: Scene) -> None:
        self.reading = reader.read(case.text, scene)
        self.types = [int(i.type) for i in scene.items]
        if isinstance(case.answer, Refusal):
            self.choices = [REFUSE + REFUSALS.index(reason_of(case.answer.reason))]
        else:
            self.choices = choices_of([(s.verb, s.robots, s.objects, s.before) for s in case.answer], scene)
        verbs = {ITEM + n for n, i in enumerate(scene.items) if i.type is ItemType.VERB}
        # place 0 is the start, so choice n stands at n + 1
        self.verbs = [n + 1 for n, c in enumerate(self.choices) if c in verbs]
        line = 0
        self.lines = [0]
        for c in self.choices:
            line += c in verbs
            self.lines.append(line)


class Rows:
    """Makes rows out of cases."""

    def __init__(self, reader: Reader) -> None:
        self.reader = reader

    def row(self, case: Case) -> Row | None:
        """Return the case's row; None if it is longer than the model can take or names what its site lacks."""
        try:
            row = Row(case, self.reader, scene_of(case.site))
        except (TooLongError, KeyError, StopIteration):
            return None
        return row if len(row.choices) < MOST_CHOICES and len(row.verbs) <= LINES else None


def batch_of(rows: Sequence[Row]) -> Batch:
    """Pad rows to one shape."""

    def padded(lists: Sequence[Sequence[int]], fill: int) -> torch.Tensor:
        width = max(map(len, lists))
        return torch.tensor([[*x, *[fill] * (width - len(x))] for x in lists])

    ids = padded([r.reading.ids for r in rows], 0)
    starts, ends = (padded([getattr(r.reading, p) for r in rows], 0) for p in ("starts", "ends"))
    length = torch.tensor([len(r.reading.ids) for r in rows])
    return Batch(
        ids=ids,
        types=padded([r.reading.types for r in rows], 0),
        seen=torch.arange(ids.shape[1])[None, :] < length[:, None],
        items=torch.stack((starts, ends), dim=-1),
        item_types=padded([r.types for r in rows], -1),
        choices=padded([[-1, *r.choices[:-1]] for r in rows], 0),
        lines=padded([r.lines[:-1] for r in rows], 0),
        verbs=padded([[*r.verbs, *[-1] * (LINES - len(r.verbs))] for r in rows], -1),
        targets=padded([r.choices for r in rows], -100),
    )


def draws(cases: Sequence[Case], made: Callable[[random.Random], Case], random_: random.Random) -> Iterator[Case]:
    """Cases without end: mostly varied hand-written ones, some joined ones, some from the generator."""
    weights = [2.0 if c.level == "L3" else 1.0 for c in cases]
    total: list[float] = []
    for w in weights:
        total.append(w + (total[-1] if total else 0.0))
    while True:
        chance = random_.random()
        if chance < 0.14:
            case = joined(random_.choice(cases), random_.choice(cases), random_)
            if case is not None:
                yield varied(case, random_, 0.4)
        elif chance < 0.36:
            yield varied(made(random_), random_, 0.5)
        else:
            yield varied(random_.choices(cases, cum_weights=total)[0], random_)


def stream(rows: Rows, cases: Iterator[Case], tokens: int, pool: int = 768) -> Iterator[Batch]:
    """Batches of about `tokens` tokens read, of rows of like length, without end."""
    random_ = random.Random(1)
    while True:
        waiting: list[Row] = []
        while len(waiting) < pool:
            row = rows.row(next(cases))
            if row is not None:
                waiting.append(row)
        waiting.sort(key=lambda r: (len(r.reading.ids), len(r.choices)))
        batches: list[list[Row]] = [[]]
        for row in waiting:
            if batches[-1] and len(row.reading.ids) * (len(batches[-1]) + 1) > tokens:
                batches.append([])
            batches[-1].append(row)
        random_.shuffle(batches)
        for b in batches:
            yield batch_of(b)
