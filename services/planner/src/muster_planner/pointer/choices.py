"""The answer as a row of choices, and which choice may follow which.

A line is: a verb, then robots (robots one by one, types with or without a count, or `all`), then objects, then the
lines that it waits for. Each of these is one choice; the next verb begins the next line. Choices are numbers: the
fixed ones first (`END`, refusals, counts, lines), then the scene's items. What may follow is known at every point, so
an answer always has known robots, able ones, known objects, and waits for earlier lines only.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from muster_planner.plan_language import label

from .scene import Item, ItemType, Scene

REFUSALS = ("absent", "unable", "circular", "hijack", "nothing", "unclear")
"""Why an instruction is refused: it names what is not here; it wants what nobody here can do; its parts wait for each
other; it tries to change the planner's task; it asks for no work; it leaves open who or what."""
COUNTS = 9
LINES = 26
END = 0
REFUSE = 1
COUNT = REFUSE + len(REFUSALS)
"""COUNT + n - 1 is "n of this type"."""
LINE = COUNT + COUNTS
"""LINE + n is "waits for line n" (from 0)."""
ITEM = LINE + LINES
"""ITEM + n is the scene's item n."""


@dataclass(frozen=True)
class Line:
    """One line: places of items in the scene, counts by kind, and the lines that it waits for."""

    verb: int
    robots: tuple[int, ...] = ()
    count: int | None = None
    objects: tuple[int, ...] = ()
    before: tuple[int, ...] = ()


@dataclass(frozen=True)
class Writing:
    """An answer in the making; immutable, so that a search may go on from it in several ways."""

    scene: Scene
    lines: tuple[Line, ...] = ()
    refusal: str | None = None
    ended: bool = False

    def after(self, choice: int) -> "Writing":
        """Return what is written after one more choice (which must be one of `allowed`)."""
        if choice == END:
            return replace(self, ended=True)
        if REFUSE <= choice < COUNT:
            return replace(self, refusal=REFUSALS[choice - REFUSE], ended=True)
        if choice >= ITEM and self.scene.items[choice - ITEM].type is ItemType.VERB:
            return replace(self, lines=(*self.lines, Line(choice - ITEM)))
        last = self.lines[-1]
        if COUNT <= choice < LINE:
            last = replace(last, count=choice - COUNT + 1)
        elif choice < ITEM:
            last = replace(last, before=(*last.before, choice - LINE))
        elif self.scene.items[choice - ITEM].type is ItemType.OBJECT:
            last = replace(last, objects=(*last.objects, choice - ITEM))
        else:
            last = replace(last, robots=(*last.robots, choice - ITEM))
        return replace(self, lines=(*self.lines[:-1], last))

    def allowed(self, *, may_refuse: bool = True) -> list[int]:
        """Return the choices that may come next."""
        if not self.lines:
            refusals = range(REFUSE, COUNT) if may_refuse else ()
            return [*self._verbs(), *refusals]
        last, items = self.lines[-1], self.scene.items
        verb = items[last.verb]
        after_robots = not last.objects and not last.before
        choices: list[int] = []
        if after_robots:
            choices += self._robots(last, verb)
        if not last.robots:
            return choices
        may_place = verb.name not in self.scene.placeless and not last.before
        if may_place:
            start = last.objects[-1] if last.objects else -1
            choices += [ITEM + n for n in self._of(ItemType.OBJECT) if n > start]
        if verb.name in self.scene.placed and not last.objects:
            return choices
        first = last.before[-1] + 1 if last.before else 0
        choices += [LINE + n for n in range(first, len(self.lines) - 1)]
        choices.append(END)
        if len(self.lines) < LINES:
            choices += self._verbs()
        return choices

    def _verbs(self) -> Iterable[int]:
        has_objects = bool(self.scene.objects)
        usable = (
            n for n in self._of(ItemType.VERB) if has_objects or self.scene.items[n].name not in self.scene.placed
        )
        able = {n for n, k in enumerate(self.scene.kinds) if k.robots}
        return [ITEM + n for n in usable if self.scene.items[n].kind in able or (self.scene.items[n].kind < 0 and able)]

    def _robots(self, line: Line, verb: Item) -> Iterable[int]:
        items = self.scene.items
        said = [items[r] for r in line.robots]
        if not said:
            kinds = [n for n in self._of(ItemType.KIND) if verb.kind in (-1, items[n].kind)]
            robots = [n for n in self._of(ItemType.ROBOT) if verb.kind in (-1, items[n].kind)]
            everyone = self._of(ItemType.ALL) if verb.kind < 0 else []
            return [ITEM + n for n in (*kinds, *robots, *everyone)]
        if said[0].type is ItemType.ROBOT:
            later = (n for n in self._of(ItemType.ROBOT) if n > line.robots[-1])
            return [ITEM + n for n in later if verb.kind in (-1, items[n].kind)]
        if said[0].type is ItemType.KIND and line.count is None:
            most = min(len(self.scene.kinds[said[0].kind].robots), COUNTS) if len(said) == 1 else 0
            more = [n for n in self._of(ItemType.KIND) if n > line.robots[-1] and verb.kind < 0]
            return [*range(COUNT, COUNT + most), *(ITEM + n for n in more)]
        return []

    def _of(self, item_type: ItemType) -> list[int]:
        return [n for n, i in enumerate(self.scene.items) if i.type is item_type]

    def said(self) -> str:
        """Return the lines in the plan language (see `plan_language`)."""
        return "\n".join(self._line(n, line) for n, line in enumerate(self.lines))

    def _line(self, place: int, line: Line) -> str:
        items = self.scene.items
        robots = [items[r] for r in line.robots]
        suffix = "*" if line.count is None else f":{line.count}"
        names = [f"{r.name}{suffix}" if r.type is ItemType.KIND else r.name for r in robots]
        text = f"{label(place)} {items[line.verb].name} {' '.join(names)}"
        if line.objects:
            text += f" @ {' '.join(items[o].name for o in line.objects)}"
        if line.before:
            text += f" < {' '.join(label(b) for b in line.before)}"
        return text


def choices_of(lines: Sequence[tuple[str, Sequence[str], Sequence[str], Iterable[int]]], scene: Scene) -> list[int]:
    """Return the choices that write lines (verb, robots, objects, lines waited for), all by their names.

    Raises:
        KeyError: the scene lacks something that a line names.

    """
    kinds = {k.letter: n for n, k in enumerate(scene.kinds)}
    kind_of = {r: n for n, k in enumerate(scene.kinds) for r in k.robots}
    choices: list[int] = []
    for verb, robots, objects, before in lines:
        said: list[int] = []
        count: list[int] = []
        doers: set[int] = set()
        for robot in robots:
            if robot == "all":
                said.append(scene.places["all", -1])
            elif robot in kind_of:
                said.append(scene.places[robot, kind_of[robot]])
                doers.add(kind_of[robot])
            else:
                letter, star, number = robot.rstrip("*").partition(":")
                said.append(scene.places[letter, kinds[letter]])
                doers.add(kinds[letter])
                if star:
                    count = [COUNT + int(number) - 1]
        kind = -1 if (verb, -1) in scene.places else next(iter(doers))
        choices.append(ITEM + scene.places[verb, kind])
        choices += [ITEM + n for n in sorted(said)]
        choices += count
        choices += sorted(ITEM + scene.places[o, -1] for o in objects)
        choices += sorted(LINE + b for b in before)
    return [*choices, END]
