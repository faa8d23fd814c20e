"""The likeliest answers, found by beam search over the choices that are allowed."""

import threading
from dataclasses import dataclass

import numpy as np

from .choices import COUNT, Writing
from .network import MOST_CHOICES, START, Floats, Memory, Network
from .scene import Scene

BEAMS = 4
SURE = 0.8
"""How likely it must be that an instruction is to be refused; a good one that is refused costs more than a bad plan,
which the gate or a person may still stop."""


class StoppedError(RuntimeError):
    """The search was asked to stop."""


@dataclass(frozen=True)
class Found:
    """An answer and the logarithm of its probability; `choices` counts what was chosen, `END` too."""

    writing: Writing
    score: float
    choices: int


def search(
    network: Network,
    memory: Memory,
    scene: Scene,
    *,
    may_refuse: bool = True,
    beams: int = BEAMS,
    most: int = MOST_CHOICES,
    stop: threading.Event | None = None,
) -> list[Found]:
    """Return the likeliest answers, best first; empty if the likeliest has more than `most` choices.

    Raises:
        StoppedError: `stop` was set.

    """
    alive = [Found(Writing(scene), 0.0, 0)]
    latest: list[int] = [START]
    lines = [0]
    written = network.nothing()
    ended: list[Found] = []
    for place in range(min(most, MOST_CHOICES)):
        if stop is not None and stop.is_set():
            raise StoppedError
        scores, written = network.write(memory, written, latest, lines, scene)
        if place == 0 and may_refuse:
            refusal = _refusal(scores[0], scene)
            if refusal is not None:
                return [refusal]
        options: list[tuple[float, int, int]] = []
        for n, one in enumerate(alive):
            allowed = one.writing.allowed(may_refuse=False)
            likely = _log_softmax(scores[n][allowed])
            best = np.argsort(likely)[::-1][:beams]
            options += [(one.score + float(likely[i]), n, allowed[i]) for i in best]
        options.sort(key=lambda o: -o[0])
        going: list[Found] = []
        places: list[int] = []
        latest = list[int]()
        for score, n, choice in options[: 2 * beams]:
            one = Found(alive[n].writing.after(choice), score, alive[n].choices + 1)
            if one.writing.ended:
                ended.append(one)
            elif len(going) < beams:
                going.append(one)
                places.append(n)
                latest.append(choice)
        ended.sort(key=lambda f: -f.score)
        if not going or (len(ended) >= beams and ended[beams - 1].score >= going[0].score):
            break
        if ended and ended[0].score > going[0].score + np.log(1000):
            break
        alive = going
        written = written.chosen(places)
        lines = [len(f.writing.lines) for f in alive]
    else:
        if not ended or ended[0].score < alive[0].score:
            return []  # the likeliest answer is longer; a short unlikely one is no substitute
    return ended[:beams]


def _refusal(scores: Floats, scene: Scene) -> Found | None:
    """Return the refusal if refusing is much likelier than to begin any plan.

    This is settled before the search, in which a long plan's probability, a product of many, would lose against a
    refusal, which is a single choice.
    """
    begun = Writing(scene)
    allowed = np.array(begun.allowed())
    likely = np.exp(_log_softmax(scores[allowed]))
    refusals = allowed < COUNT
    if likely[refusals].sum() < SURE:
        return None
    best = int(np.where(refusals, likely, 0.0).argmax())
    return Found(begun.after(int(allowed[best])), float(np.log(likely[best])), 1)


def _log_softmax(x: Floats) -> Floats:
    x = x - x.max()
    return x - np.log(np.exp(x).sum())
