"""The noise of people in a hurry."""

import random
import re


def noisy(text: str, random_: random.Random) -> str:
    """Return the text as hurried people type it: case, punctuation, typos. Numbers and short names stay whole."""
    chance = random_.random()
    if chance < 0.16:
        text = text.lower()
    elif chance < 0.19:
        text = text.upper()
    if random_.random() < 0.10:
        text = re.sub(r"[.,;:!?](?=\s|$)", "", text)
    if random_.random() < 0.06:
        text = text.rstrip(".!? ")
    if random_.random() < 0.12:
        words = text.split(" ")
        for _ in range(random_.randint(1, max(1, len(words) // 12))):
            at = random_.randrange(len(words))
            words[at] = _typo(words[at], random_)
        text = " ".join(words)
    if random_.random() < 0.1:
        digits = {"1": "one", "2": "two", "3": "three"}
        text = re.sub(r"(?<= )([123])(?=[ ,.;]|$)(?!\.\d)", lambda m: digits[m[1]], text)
    return text


def _typo(word: str, random_: random.Random) -> str:
    if len(word) < 4 or not word.isalpha():
        return word
    at = random_.randrange(1, len(word) - 1)
    return random_.choice(
        (
            word[:at] + word[at + 1 :],
            word[:at] + word[at] + word[at:],
            word[:at] + word[at + 1] + word[at] + word[at + 2 :],
            word[:at] + random_.choice("aeiourtsn") + word[at + 1 :],
        )
    )
