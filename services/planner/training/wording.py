"""How robots, places and single steps are said."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .notation import Step
from .sites import Site
from .who import Who

_NOUNS = {
    "E": ("excavator", "digger", "excavator", "exc", "EX", "E"),
    "T": ("truck", "dump truck", "truck", "tipper", "dumper", "hauler", "DT", "T", "lorry"),
}
_CODES = {"exc", "EX", "E", "DT", "T"}
_DIGITS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six", 7: "seven", 8: "eight"}
_ORDINALS = {1: "first", 2: "second", 3: "third"}


@dataclass(frozen=True)
class Act:
    """One step of a branch: `said` is its clause, `done` how its end is said ("truck 1 has tipped")."""

    step: Step
    said: str
    done: str
    subject: str = ""


class Words:
    """Draws robots (each in one branch only), and says things in one speaker's way."""

    def __init__(self, site: Site, random_: random.Random) -> None:
        self.site, self._random = site, random_
        self._noun = {k.letter: random_.choice(self.nouns(k.letter)) for k in site.kinds}
        self._number: Callable[[int], str] = random_.choice((str, str, str, str, _DIGITS.__getitem__))
        self._classes: dict[str, int] = {}
        for name in site.objects:
            self._classes[name.rstrip("0123456789")] = self._classes.get(name.rstrip("0123456789"), 0) + 1
        self._style = random_.random()
        self.fresh()

    def fresh(self) -> None:
        """Make every robot free again."""
        self._free: dict[str, list[int]] = {k.letter: list(k.numbers) for k in self.site.kinds}

    def pick(self, options: Sequence[str]) -> str:
        """Return one of the options."""
        return self._random.choice(options)

    def nouns(self, letter: str) -> Sequence[str]:
        """Return the words for a type of robot."""
        kind = next((k for k in self.site.kinds if k.letter == letter), None)
        return _NOUNS.get(letter) or ((kind.words, kind.words, letter) if kind else ("robot",))

    def name(self, letter: str, number: int) -> str:
        """Return "truck 2", "DT2", "the second excavator", ..."""
        noun = self._noun[letter]
        if noun in _CODES or len(noun) == 1:
            return f"{noun}{self._random.choice(('', '', ' ', '-')) if noun != letter else ''}{number}"
        if self._random.random() < 0.06:
            return f"{noun} {self.pick(('no. ', 'number ', '#'))}{number}"
        return f"{noun} {self._number(number)}"

    def place(self, name: str) -> str:
        """Return "puddle 2", "the second puddle", "the rock", ... (a bare class is number 1)."""
        kind, number = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
        if not number:
            return f"the {kind}"
        n = int(number)
        word = kind
        if kind == "soil":
            word = (
                self.pick(("soil", "soil pile", "soil"))
                if self._style < 0.7
                else self.pick(("pile", "heap", "soil pile"))
            )
        if kind == "soil" and word == "soil":
            return f"soil {self._number(n)}"
        if n == 1 and (self._classes.get(kind, 0) <= 1 or self._random.random() < 0.3):
            return f"the {word}"
        if n in _ORDINALS and self._random.random() < 0.08:
            return f"the {_ORDINALS[n]} {word}"
        return f"{word} {self._number(n) if n < 9 else n}"

    def absent_object(self) -> str:
        """Return the name of something that the site lacks."""
        names = [
            f"{k}{i}"
            for k in ("puddle", "obstacle", "rock", "soil", "trench", "gate", "pond", "bridge", "tower")
            for i in range(1, 6)
        ]
        return self._random.choice([n for n in names if n not in self.site.objects])

    def anyone(self) -> Who:
        """Return all robots."""
        return Who(("all",), self.pick(("everybody", "the whole fleet", "all machines")), plural=False)

    def robots(self, kind: str | None, most: int, *, groups: bool = False, reserve: bool = True) -> Who | None:
        """Draw robots of one type (any if None) that no branch has yet; None if there are none."""
        letters = [k for k in self._free if self._free[k] and kind in (None, k)]
        if not letters:
            return None
        letter = self._random.choice(letters)
        free, whole = self._free[letter], next(k.numbers for k in self.site.kinds if k.letter == letter)
        chance = self._random.random()
        if (
            groups
            and chance < 0.12
            and (not reserve or all(len(self._free[k.letter]) == len(k.numbers) for k in self.site.kinds))
        ):
            if reserve:
                self._free = {k: list[int]() for k in self._free}
            return self.anyone()
        plural = self._plural(letter)
        if len(free) == len(whole) > 1 and chance < (0.4 if groups else 0.08):
            if reserve:
                free.clear()
            return Who(
                (f"{letter}*",),
                self.pick((f"all {plural}", f"all the {plural}", f"the {plural}", f"the {plural}"))
                if not plural.endswith("ies")
                else f"all {plural}",
                plural=True,
            )
        if reserve and len(free) == len(whole) > 2 and chance > 0.96 and letter in "ET":
            count = 2
            free.clear()
            return Who(
                (f"{letter}:{count}",), self.pick((f"two {plural}", f"any two {plural}", f"2 {plural}")), plural=True
            )
        numbers = sorted(self._random.sample(free, min(len(free), self._random.randint(1, most))))
        if reserve:
            for n in numbers:
                free.remove(n)
        codes = tuple(f"{letter}{n}" for n in numbers)
        if len(numbers) == 1:
            return Who(codes, self.name(letter, numbers[0]), plural=False)
        noun = self._noun[letter]
        if noun in _CODES or len(noun) == 1:
            text = self.pick((" and ", " & ")).join(f"{noun}{n}" for n in numbers)
        elif len(numbers) == 2:
            text = f"{plural} {self._number(numbers[0])} and {self._number(numbers[1])}"
        else:
            text = f"{plural} {', '.join(self._number(n) for n in numbers[:-1])} and {self._number(numbers[-1])}"
        return Who(codes, text, plural=True)

    def _plural(self, letter: str) -> str:
        noun = self._noun[letter]
        if noun in _CODES or len(noun) == 1:
            noun = {"E": "excavator", "T": "truck"}.get(
                letter, next(k.words for k in self.site.kinds if k.letter == letter)
            )
        return "lorries" if noun == "lorry" else f"{noun}s"

    def clause(self, who: Who, said: str) -> str:
        """Return robots and what they do as a clause."""
        return self._random.choice(
            (
                f"{who.name} {who.s(said)}",
                f"{who.name} {who.s(said)}",
                f"{who.name} {who.s(said)}",
                f"{who.name}, {said}",
                f"{who.name} {self.pick(('should', 'must', 'shall', 'can', f'{who.are} to'))} {said}",
                f"{self.pick(('have', 'let'))} {who.name} {said}",
                f"I want {who.name} to {said}",
                f"{who.name}: {said}",
                f"please {self.pick(('get', 'tell'))} {who.name} to {said}",
            )
        )

    def go(self, who: Who, place: str) -> Act:
        """Return the act of driving."""
        x = self.place(place)
        said = self.pick(
            (
                f"go to {x}",
                f"drive to {x}",
                f"head to {x}",
                f"head over to {x}",
                f"check {x}",
                f"inspect {x}",
                f"have a look at {x}",
                f"move to {x}",
                f"proceed to {x}",
                f"get to {x}",
                f"swing by {x}",
            )
        )
        looked = said.split(" ")[0] in ("check", "inspect", "have")
        done = self.pick(
            (
                f"{who.name} {who.has} reached {x}",
                f"{who.name} {who.are} at {x}",
                f"{who.name} {who.has} arrived at {x}",
                f"{who.name} {'get' if who.plural else 'gets'} to {x}",
            )
        )
        if looked:
            done = self.pick((f"{who.name} {who.has} checked {x}", f"{who.name} {who.has} had a look at {x}", done))
        return _act("go", who, (place,), said, done)

    def home(self, who: Who) -> Act:
        """Return the act of going back to the start."""
        said = self.pick(
            ("go home", "return to start", "head back", "come home", "go back to the start", "return", "head home")
        )
        done = self.pick(
            (
                f"{who.name} {who.are} home",
                f"{who.name} {who.has} returned",
                f"{who.name} {who.are} back at the start",
            )
        )
        return _act("home", who, (), said, done)

    def dig(self, who: Who, place: str) -> Act:
        """Return the act of digging."""
        done = self.pick(
            (
                f"{who.name} {who.has} dug",
                f"{who.name} {who.has} finished digging",
                f"{who.name} {who.are} done digging at {self.place(place)}",
            )
        )
        return _act("dig", who, (place,), "dig", done)

    def dump(self, who: Who, place: str) -> Act:
        """Return the act of emptying the bucket."""
        done = self.pick(
            (
                f"{who.name} {who.has} unloaded",
                f"{who.name} {who.has} emptied the bucket",
                f"{who.name}'s bucket is empty",
            )
        )
        return _act("dump", who, (place,), "unload", done)

    def load(self, who: Who, place: str) -> Act:
        """Return the act of taking on load."""
        return _act("load", who, (place,), "load", f"{who.name} {who.are} loaded")

    def tip(self, who: Who, place: str) -> Act:
        """Return the act of tipping."""
        done = self.pick(
            (
                f"{who.name} {who.has} tipped",
                f"{who.name} {who.has} dumped the load",
                f"{who.name} {who.are} empty",
            )
        )
        return _act("tip", who, (place,), "tip", done)

    def rule(self, who: Who, verb: str, objects: tuple[str, ...], what: str) -> Act:
        """Return the act of closing or opening places."""
        if verb == "avoid":
            said = self.pick(
                (
                    f"avoid {what}",
                    f"keep away from {what}",
                    f"stay clear of {what}",
                    f"steer clear of {what}",
                    f"keep out of {what}",
                    f"stay away from {what}",
                )
            )
            done = self.pick((f"the ban on {what} is in place", f"{what} {'are' if ' and ' in what else 'is'} closed"))
        else:
            said = self.pick(
                (
                    f"enter {what} again",
                    f"use {what} again",
                    f"go into {what} again if need be",
                    f"have access to {what} again",
                    f"be allowed back into {what}",
                )
            )
            done = self.pick(
                (f"{what} {'are' if ' and ' in what else 'is'} open again", f"the ban on {what} is lifted")
            )
        return _act(verb, who, objects, said, done)


def _act(verb: str, who: Who, objects: tuple[str, ...], said: str, done: str) -> Act:
    return Act(Step(verb, who.codes, objects), said, done, subject=who.name)


def capital(text: str) -> str:
    """Return the text with a capital at its start."""
    return text[:1].upper() + text[1:]
