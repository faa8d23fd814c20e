"""Instructions that cannot be planned on their site, with the reason."""

import random

from .notation import Refusal
from .sites import NEW_KINDS
from .wording import Words, capital


def refused(words: Words, random_: random.Random) -> tuple[str, Refusal]:
    """Return a text and why it is refused: an absent place, robot or type, or work that a type cannot do."""
    site = words.site
    absent = words.absent_object()
    who = words.robots(kind=None, most=1) or words.anyone()
    chance = random_.random()
    if chance < 0.4:
        name = words.place(absent)
        text = random_.choice(
            (
                f"{who.name} to {name}.",
                f"Send {who.name} over to {name}.",
                f"{who.name}, check {name}.",
                f"Keep {who.name} away from {name}.",
                f"Get {who.name} to {name} and back home after.",
            )
        )
        return text, Refusal(f"there is no {name.removeprefix('the ')} here")
    if chance < 0.8:
        kind = random_.choice(site.kinds)
        number = random_.choice([n for n in range(1, 9) if n not in kind.numbers])
        word = random_.choice(words.nouns(kind.letter))
        place = words.place(random_.choice(site.objects))
        text = random_.choice(
            (
                f"{word} {number} to {place}.",
                f"Send {word} {number} home.",
                f"{word} {number} avoids {place}.",
                f"{who.name} goes home and {word} {number} goes to {place}.",
                f"{word} {number}: drive to {place}.",
            )
        )
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
