"""Pieces of work that a team does: the steps and one way to say them."""

import random
from collections.abc import Callable
from dataclasses import dataclass, replace

from .notation import Step
from .wording import Act, Words


@dataclass
class Branch:
    """Acts in a row or a small graph, and the words for all of them."""

    acts: list[Act]
    text: str


def _row(*acts: Act) -> list[Act]:
    """Let every act wait for the one before it."""
    return [replace(a, step=replace(a.step, before=frozenset({n - 1} if n else ()))) for n, a in enumerate(acts)]


def _and(parts: list[str], random_: random.Random) -> str:
    if len(parts) == 1:
        return parts[0]
    glue = random_.choice((", then ", " and then ", ", ", " and ", ", after that "))
    return ", ".join(parts[:-1]) + (glue if glue != ", " else " and ") + parts[-1]


def _visit(words: Words, random_: random.Random) -> Branch | None:
    who = words.robots(kind=None, most=2)
    if who is None:
        return None
    places = random_.sample(words.site.objects, min(len(words.site.objects), random_.choice((1, 1, 1, 2, 3))))
    acts = [words.go(who, p) for p in places]
    if random_.random() < 0.3:
        acts.append(words.home(who))
    if random_.random() < 0.15 and len(acts) > 1:
        # said backwards
        first, then = acts[:-1], acts[-1]
        text = f"before {who.name} {who.s(then.said)}, {who.it} {who.s(_and([a.said for a in first], random_))}"
        return Branch(_row(*acts), text)
    return Branch(_row(*acts), words.clause(who, _and([a.said for a in acts], random_)))


def _home(words: Words, _random: random.Random) -> Branch | None:
    who = words.robots(kind=None, most=3, groups=True)
    return None if who is None else Branch([words.home(who)], words.clause(who, words.home(who).said))


def _dig(words: Words, random_: random.Random) -> Branch | None:
    who = words.robots(kind="E", most=2)
    if who is None:
        return None
    place = random_.choice(words.site.objects)
    there, clear = random_.random() < 0.3, random_.random() < 0.4
    acts = [words.dig(who, place)]
    if not there:
        acts.insert(0, words.go(who, place))
    what = words.place(place)
    said = [
        random_.choice((f"clear {what}", f"remove {what}", f"get {what} out of the way", f"dig {what} out"))
        if clear
        else random_.choice((f"dig at {what}", f"go to {what} and dig", f"drive to {what} and start digging"))
    ]
    if there:
        said = [
            random_.choice((f"dig at {what}, where {who.they_are} already", f"dig at {what} ({who.they_are} there)"))
        ]
    if random_.random() < 0.35:
        acts.append(words.dump(who, place))
        said.append(
            random_.choice(
                ("put it aside", "set it down beside", "empty the bucket there", "unload", "dump it next to it")
            )
        )
    if random_.random() < 0.25:
        acts.append(words.home(who))
        said.append(acts[-1].said)
    return Branch(_row(*acts), words.clause(who, _and(said, random_)))


def _tip(words: Words, random_: random.Random) -> Branch | None:
    who = words.robots(kind="T", most=2)
    if who is None:
        return None
    place = random_.choice(words.site.objects)
    what = words.place(place)
    acts = [words.go(who, place), words.tip(who, place)]
    said = [
        random_.choice(
            (
                f"tip at {what}",
                f"drive to {what} and tip",
                f"take the load to {what} and tip it",
                f"haul to {what} and dump",
                f"unload at {what}",
                f"go to {what}, tip there",
            )
        )
    ]
    if random_.random() < 0.2:
        acts.pop(0)
        said = [random_.choice((f"tip at {what}, where {who.they_are}", f"tip at {what} ({who.they_are} there)"))]
    if random_.random() < 0.3:
        acts.append(words.home(who))
        said.append(acts[-1].said)
    return Branch(_row(*acts), words.clause(who, _and(said, random_)))


def _loading(words: Words, random_: random.Random) -> Branch | None:
    digger, truck = words.robots(kind="E", most=1), words.robots(kind="T", most=1)
    if digger is None or truck is None:
        return None
    place, goal = random_.choice(words.site.objects), random_.choice(words.site.objects)
    e, t, x = digger.name, truck.name, words.place(place)
    drive, dig = words.go(digger, place), words.dig(digger, place)
    come, dump = words.go(truck, place), words.dump(digger, place)
    acts = [
        drive,
        come,
        replace(dig, step=replace(dig.step, before=frozenset({0}))),
        replace(dump, step=replace(dump.step, before=frozenset({1, 2}))),
    ]
    forms = [
        f"{e} loads {t} at {x}",
        f"at {x}, {e} loads soil into {t}",
        f"{e} and {t} go to {x}, {e} digs and fills the truck",
        f"send {e} and {t} to {x}; the digger digs once it's there and unloads into the truck",
        f"{e} goes to {x} and digs, {t} comes over too, and {e} empties into it",
        f"have {e} fill {t} at {x}",
        f"get {t} filled at {x} by {e}",
        f"let {e} load {t} with soil at {x}",
        f"{e} drives to {x} and digs; {t} drives there as well and gets the bucket",
    ]
    if random_.random() < 0.25:
        forms = [
            f"{e} digs at {x}, where it stands, and empties into {t}, which is there too",
            f"{e} and {t} are at {x} already: dig and fill the truck",
            f"at {x}, where both {e} and {t} are waiting, the digger digs and unloads into the truck",
        ]
        acts = _row(dig, dump)
    text = random_.choice(forms)
    dumped = len(acts) - 1
    waited = {dumped}
    if random_.random() < 0.25:
        load = words.load(truck, place)
        before = acts[dumped].step.before
        acts.append(replace(load, step=replace(load.step, before=before)))
        waited.add(dumped + 1)
        text += random_.choice(
            (f", {t} taking on the load", f" while {t} loads", f", with {t} loading", f", {t} gets loaded")
        )
    rest: list[str] = []
    if random_.random() < 0.7:
        away = words.go(truck, goal)
        acts.append(replace(away, step=replace(away.step, before=frozenset(waited))))
        y = words.place(goal)
        if random_.random() < 0.85:
            tip = words.tip(truck, goal)
            acts.append(replace(tip, step=replace(tip.step, before=frozenset({len(acts) - 1}))))
            rest.append(
                random_.choice(
                    (
                        f"hauls it to {y} and tips",
                        f"takes it to {y} and tips there",
                        f"tips at {y}",
                        f"drives to {y} and unloads",
                        f"runs it over to {y} and dumps it",
                    )
                )
            )
        else:
            rest.append(random_.choice((f"drives to {y}", f"goes on to {y}", f"heads for {y}")))
        waited = {len(acts) - 1}
    if random_.random() < 0.25:
        back = words.home(truck)
        acts.append(replace(back, step=replace(back.step, before=frozenset(waited))))
        rest.append(random_.choice(("goes home", "returns to its start", "heads back home")))
    if rest:
        lead = random_.choice(
            (", then {t} ", "; {t} then ", ". Loaded, {t} ", ", and {t} ", ". {t} then ", "; the truck ")
        )
        text += lead.format(t=t) + _and(rest, random_)
    if random_.random() < 0.15:
        back = words.home(digger)
        acts.append(replace(back, step=replace(back.step, before=frozenset({dumped}))))
        text += random_.choice((f"; {e} goes home after unloading", f". {e} heads home once its bucket is empty"))
    return Branch(acts, text)


def _rule(words: Words, random_: random.Random) -> Branch | None:
    who = words.robots(kind=None, most=2, groups=True, reserve=False)
    if who is None:
        return None
    objects = random_.sample(words.site.objects, min(len(words.site.objects), random_.choice((1, 1, 1, 2))))
    what = " and ".join(words.place(o) for o in objects)
    act = words.rule(who, "avoid" if random_.random() < 0.6 else "allow", tuple(objects), what)
    return Branch([act], words.clause(who, act.said))


def _corrected(words: Words, random_: random.Random) -> Branch | None:
    who = words.robots(kind=None, most=1)
    other = words.robots(kind=None, most=1, reserve=False)
    if who is None or other is None or len(words.site.objects) < 2:
        return None
    wrong, right = random_.sample(words.site.objects, 2)
    act = words.go(who, right)
    a, b = words.place(wrong), words.place(right)
    forms = (
        f"{who.name} goes to {a}, no, {b}",
        f"send {who.name} to {a}... sorry, {b}",
        f"{who.name} to {a}, wait, make that {b}",
        f"{who.name} to {a}. Scratch that, to {b}",
        f"{other.name}, no, {who.name} drives to {b}",
        f"{other.name} to {b}, correction: {who.name}",
        f"I said {a} for {who.name}, I meant {b}",
    )
    form = random_.choice(forms if who.codes != other.codes else forms[:4])
    return Branch([act], form)


def _same(words: Words, random_: random.Random) -> Branch | None:
    kind = random_.choice("ET")
    one, two = words.robots(kind=kind, most=1), words.robots(kind=kind, most=1)
    if one is None or two is None or len(words.site.objects) < 2:
        return None
    here, there = random_.sample(words.site.objects, 2)
    x, y = words.place(here), words.place(there)
    last = words.dig if kind == "E" else words.tip
    acts = [words.go(one, here), last(one, here), words.go(two, there), last(two, there)]
    acts = [*_row(*acts[:2]), acts[2], replace(acts[3], step=replace(acts[3].step, before=frozenset({2})))]
    verb = "digs" if kind == "E" else "tips"
    forms = (
        f"{one.name} goes to {x} and {verb}, {two.name} does the same at {y}",
        f"{one.name} drives to {x} and {verb} there; same for {two.name} at {y}",
        f"{one.name} takes {x}, {two.name} takes {y}, and each {verb} when it gets there",
        f"{one.name} to {x}, {two.name} to {y}, each {verb} on arrival",
    )
    return Branch(acts, random_.choice(forms))


def _new_work(words: Words, random_: random.Random) -> Branch | None:
    kinds = [k for k in words.site.kinds if k.letter not in "ET"]
    if not kinds:
        return _visit(words, random_)
    kind = random_.choice(kinds)
    who = words.robots(kind=kind.letter, most=2)
    if who is None:
        return None
    place, verb = random_.choice(words.site.objects), random_.choice(kind.verbs)
    what = words.place(place)
    act = Act(
        Step(verb, who.codes, (place,)),
        f"{verb} at {what}",
        f"{who.name} {who.has} finished at {what}",
        subject=who.name,
    )
    if random_.random() < 0.3:
        return Branch([replace(act, step=replace(act.step, objects=()))], words.clause(who, verb))
    return Branch(_row(words.go(who, place), act), words.clause(who, f"go to {what} and {verb}"))


BRANCHES: tuple[Callable[[Words, random.Random], Branch | None], ...] = (
    _visit,
    _visit,
    _home,
    _dig,
    _dig,
    _tip,
    _tip,
    _loading,
    _loading,
    _loading,
    _rule,
    _corrected,
    _same,
    _new_work,
)
