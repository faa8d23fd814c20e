"""Robots as they stand in a plan and as they are said."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Who:
    """Robots as they stand in the plan and as they are said."""

    codes: tuple[str, ...]
    name: str
    plural: bool

    @property
    def has(self) -> str:
        """Return "has" or "have"."""
        return "have" if self.plural else "has"

    @property
    def are(self) -> str:
        """Return "is" or "are"."""
        return "are" if self.plural else "is"

    @property
    def it(self) -> str:
        """Return the pronoun."""
        return "they" if self.plural else "it"

    @property
    def they_are(self) -> str:
        """Return "they are" or "it is"."""
        return "they are" if self.plural else "it is"

    def s(self, said: str) -> str:
        """Return clauses such as "go to X and dig" in the third person."""
        if self.plural:
            return said
        out: list[str] = []
        start = True
        for word in said.split(" "):
            out.append(_third(word) if start and word.isalpha() else word)
            start = word.rstrip(",") in ("and", "then", "that", "after") or word.endswith(",")
            if word in ("then", "and") or (start and word.endswith(",")):
                start = True
        return " ".join(out)


_VERBS = {
    "go",
    "drive",
    "head",
    "check",
    "inspect",
    "dig",
    "clear",
    "remove",
    "get",
    "tip",
    "take",
    "haul",
    "unload",
    "return",
    "put",
    "set",
    "empty",
    "dump",
    "avoid",
    "keep",
    "stay",
    "steer",
    "move",
    "have",
    "come",
    "proceed",
    "enter",
    "use",
    "push",
    "compact",
    "lift",
    "lower",
    "scoop",
    "spray",
    "level",
    "scan",
    "start",
    "swing",
    "visit",
    "drop",
}


def _third(word: str) -> str:
    if word not in _VERBS:
        return word
    if word == "have":
        return "has"
    if word == "empty":
        return "empties"
    return word + ("es" if word in ("go", "push") else "s")
