"""Instructions that cannot be planned on their site, with the reason, and their twins that can.

What cannot be planned often differs in one number from what can, so the same sentences are said of robots and things
that are there: the model must look them up instead of taking the sentence for a sign.
"""

import random

from .notation import Answer, Refusal, Step, canonical
from .sites import NEW_KINDS
from .wording import Words, capital

_PLACE = (
    ("{who} to {name}.", ("go",)),
    ("Send {who} over to {name}.", ("go",)),
    ("{who} goes to {name}.", ("go",)),
    ("{who}, check {name}.", ("go",)),
    ("Keep {who} away from {name}.", ("avoid",)),
    ("Get {who} to {name} and back home after.", ("go", "home")),
    ("{who} drives to {name}, then home.", ("go", "home")),
)
_ROBOT = (
    ("{robot} to {place}.", ("go",)),
    ("Send {robot} home.", ("home",)),
    ("{robot} goes home.", ("home",)),
    ("{robot} avoids {place}.", ("avoid",)),
    ("{robot}: drive to {place}.", ("go",)),
    ("{robot} drives to {place}.", ("go",)),
    ("Have {robot} take a look at {place}.", ("go",)),
    ("{robot} may enter {place} again.", ("allow",)),
)


def one_thing(words: Words, random_: random.Random, *, absent: bool) -> tuple[str, Answer]:
    """Return a short text about one robot and one place, one of which may be absent, and its answer."""
    site = words.site
    known = random_.choice(site.objects)
    if random_.random() < 0.45:
        who = words.robots(kind=None, most=1) or words.anyone()
        name = words.place(words.absent_object() if absent else known)
        text, verbs = random_.choice(_PLACE)
        codes, said = who.codes, text.format(who=who.name, name=name)
        reason = f"there is no {name.removeprefix('the ')} here"
    else:
        kind = random_.choice(site.kinds)
        others = [n for n in range(1, 9) if n not in kind.numbers]
        number = random_.choice(others if absent else kind.numbers)
        robot = f"{random_.choice(words.nouns(kind.letter))} {number}"
        text, verbs = random_.choice(_ROBOT)
        codes, said = (f"{kind.letter}{number}",), text.format(robot=robot, place=words.place(known))
        reason = f"there is no {robot} here"
    if absent:
        return capital(said), Refusal(reason)
    steps = [
        Step(v, codes, () if v == "home" else (known,), frozenset({n - 1} if n else ())) for n, v in enumerate(verbs)
    ]
    return capital(said), canonical(steps)


def refused(words: Words, random_: random.Random) -> tuple[str, Refusal]:
    """Return a text and why it is refused: an absent place, robot or type, or work that a type cannot do."""
    site = words.site
    chance = random_.random()
    if chance < 0.7:
        text, answer = one_thing(words, random_, absent=True)
        return text, answer if isinstance(answer, Refusal) else Refusal("no instruction")
    if chance < 0.8:
        who = words.robots(kind=None, most=1) or words.anyone()
        kind = random_.choice(site.kinds)
        number = random_.choice([n for n in range(1, 9) if n not in kind.numbers])
        word = random_.choice(words.nouns(kind.letter))
        place = words.place(random_.choice(site.objects))
        text = f"{who.name} goes home and {word} {number} goes to {place}."
        return capital(text), Refusal(f"there is no {word} {number} here")
    if chance < 0.9:
        kind = random_.choice(NEW_KINDS)
        if kind.letter in {k.letter for k in site.kinds} or kind.words in {k.words for k in site.kinds}:
            return "Hello?", Refusal("no instruction")
        place = words.place(random_.choice(site.objects))
        return capital(f"{kind.words} {random_.choice((1, 2))} goes to {place}."), Refusal(
            f"there is no {kind.words} here"
        )
    pair = random_.choice((("E", "tip its bed", "an excavator cannot tip"), ("T", "dig", "a dump truck cannot dig")))
    wrong = words.robots(kind=pair[0], most=1)
    if wrong is None:
        return "How was your weekend?", Refusal("small talk, no instruction")
    return f"{wrong.name} shall {pair[1]} at {words.place(random_.choice(site.objects))}.", Refusal(pair[2])
