"""The embedded model's prompt: what is on the site now, then the instruction.

The first part is the same for all instructions until the site changes, so its evaluation is kept. The model was
trained on exactly this form (`training/sites.py` says it too, and a test holds the two together).
"""

import re

from .short_names import SiteNames

_MARK = re.compile(r"<\|[^|>]*\|>")
"""Marks of the chat format; an instruction must not end its own part of the prompt."""


def prompt(names: SiteNames, text: str) -> str:
    """Return the whole prompt for an instruction."""
    return site_part(names) + f"{_said_short(_MARK.sub(' ', text), names).strip()}<|im_end|>\n<|im_start|>assistant\n"


def site_part(names: SiteNames) -> str:
    """Return the part of the prompt that all instructions share."""
    lines = [f"{k.words} {' '.join(k.robots)}: {' '.join(k.verbs)}" for k in names.kinds]
    common = " ".join(s.verb for s in names.common)
    return (
        "<|im_start|>system\n" + "\n".join(lines) + f"\nall: {common}\n"
        f"at: {' '.join(names.objects)}<|im_end|>\n<|im_start|>user\n"
    )


def _said_short(text: str, names: SiteNames) -> str:
    """Return the text with whole robot ids (`robot_dump_truck_02`) as short names, which the model knows."""
    if not any(full in text for full in names.short_names):
        return text
    pattern = "|".join(re.escape(f) for f in sorted(names.short_names, key=len, reverse=True))
    return re.sub(rf"(?<![\w-])(?:{pattern})(?![\w-])", lambda m: names.short_names[m[0]], text)
