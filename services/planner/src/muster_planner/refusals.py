"""What a refusal says to the operator: why, and what would do instead."""

from .short_names import SiteNames


def explained(reason: str, names: SiteNames) -> str:
    """Return the sentence for one of `pointer.choices.REFUSALS` on this site."""
    match reason:
        case "absent":
            return f"It names a robot, a place or a thing that is not here. {_here(names)}"
        case "unable":
            return f"It wants what the robots here cannot do. {_able(names)}"
        case "circular":
            return "Its parts wait for each other, so none could ever begin. Say which one comes first."
        case "hijack":
            return "It tries to change the planner's own task. Say only what the robots shall do."
        case "unclear":
            return "It leaves open which robot shall do what, and where. Say both."
        case _:
            return "It asks for no work of the robots. Say which robot shall do what, and where."


def _here(names: SiteNames) -> str:
    robots = "; ".join(f"{k.words} {', '.join(r.removeprefix(k.letter) for r in k.robots)}" for k in names.kinds)
    return f"Robots here: {robots or 'none'}. Objects seen: {', '.join(names.objects) or 'none'}."


def _able(names: SiteNames) -> str:
    kinds = "; ".join(f"{k.words}: {', '.join(k.verbs)}" for k in names.kinds if k.verbs)
    common = ", ".join(s.verb for s in names.common)
    return (
        f"Every robot can: {common or 'nothing'}. Besides, {kinds}." if kinds else f"Robots can: {common or 'nothing'}."
    )
