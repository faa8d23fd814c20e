"""How branches of work wait for each other, and how that is said: in front, behind, late, or for an inner step."""

import random
from collections.abc import Sequence
from dataclasses import replace

from .branches import Branch
from .notation import Step
from .wording import Act


def numbered(branches: list[Branch]) -> tuple[list[Act], list[int]]:
    """Return the acts of all branches, their waits counted over all, and where each branch starts."""
    acts: list[Act] = []
    starts: list[int] = []
    for branch in branches:
        shift = len(acts)
        starts.append(shift)
        for act in branch.acts:
            before = frozenset(b + shift for b in act.step.before)
            acts.append(replace(act, step=replace(act.step, before=before)))
    return acts, starts


def useful(acts: Sequence[Act], chosen: Sequence[int]) -> list[int]:
    """Drop of the acts waited for those that another of them implies, as a speaker would."""

    def above(n: int) -> set[int]:
        return {b for p in acts[n].step.before for b in ({p} | above(p))}

    implied = {b for c in chosen for b in above(c)}
    return sorted(set(chosen) - implied)


def late_wait(
    acts: list[Act], steps: list[Step], starts: list[int], waits: dict[int, list[int]], random_: random.Random
) -> str:
    """Sometimes let an act inside a branch wait for an act of an earlier branch; return the sentence that says so."""
    inner = [i for i in range(1, len(acts)) if i not in starts and acts[i].subject]
    if not inner or len(starts) < 2 or random_.random() > 0.3:
        return ""
    at = random_.choice(inner)
    home = max(s for s in starts if s <= at)
    if home == 0:
        return ""
    source = random_.randrange(home)
    if source in waits.get(starts.index(home), []):
        return ""
    steps[at] = replace(steps[at], before=steps[at].before | {source})
    act, done = acts[at], acts[source].done
    forms = (
        f"{act.subject} doesn't {act.said} until {done}.",
        f"{act.subject} may only {act.said} once {done}.",
        f"Before {act.subject} can {act.said}, make sure {done}.",
        f"Oh, and {act.subject} only gets to {act.said} when {done}.",
        f"But {act.subject} must not {act.said} before {done}.",
        f"One condition: {act.subject} won't {act.said} unless {done}.",
        f"Nota bene: for {act.subject} to {act.said}, wait until {done}.",
    )
    sentence = random_.choice(forms)
    return sentence[0].upper() + sentence[1:]


def with_wait(text: str, dones: list[str], random_: random.Random, *, follows: bool) -> str:
    """Return the branch's text with the condition that it starts under (none: perhaps a word for "beside")."""
    if not dones:
        if follows and random_.random() < 0.35:
            lead = random_.choice(
                (
                    "Meanwhile ",
                    "In parallel, ",
                    "At the same time ",
                    "In the meantime ",
                    "Separately, ",
                    "Without waiting for that, ",
                    "Independently, ",
                    "Also, ",
                )
            )
            return lead + text
        return text
    both = dones[0] if len(dones) == 1 else ", ".join(dones[:-1]) + random_.choice((" and ", ", and ")) + dones[-1]
    forms = (
        "Once {d}, {t}",
        "When {d}, {t}",
        "As soon as {d}, {t}",
        "After {d}, {t}",
        "{t}, but only once {d}",
        "{t}, but not before {d}",
        "{t} after {d}",
        "Wait until {d}, then {t}",
        "Only when {d}: {t}",
        "{t} as soon as {d}",
        "Not until {d}: {t}",
        "The moment {d}, {t}",
        "Hold the next bit till {d}: {t}",
        "{t}, provided {d}",
        "{t} (only after {d})",
        "Once {d} and not sooner, {t}",
        "If and when {d}: {t}",
    )
    form = random_.choice(forms)
    # A condition behind several clauses would be read as the last clause's only
    if form.startswith("{t}") and (", " in text or " and " in text or ". " in text or ";" in text):
        form = random_.choice([f for f in forms if not f.startswith("{t}")])
    return form.format(d=both, t=text)


def reordered(steps: list[Step], bounds: list[int], branches: list[int]) -> list[Step]:
    """Put the branches' steps in the order in which the branches are said."""
    order = [i for n in branches for i in range(bounds[n], bounds[n + 1])]
    place = {old: new for new, old in enumerate(order)}
    return [replace(steps[i], before=frozenset(place[b] for b in steps[i].before)) for i in order]
