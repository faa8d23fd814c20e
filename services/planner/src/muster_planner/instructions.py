"""What an instruction's text must be before anything is done with it."""

import unicodedata

from muster_schemas.mission import MAX_TEXT


class InstructionError(ValueError):
    """A text that is no instruction; the message says what to do."""


def clean_instruction(text: str) -> str:
    """Return the text in Unicode's composed form (NFC), without control characters, trimmed.

    Line breaks and tabs become spaces, so that a pasted list stays readable to a model that works line by line.

    Raises:
        InstructionError: nothing is left, or it is longer than `MAX_TEXT`.

    """
    spaced = "".join(" " if c in "\n\r\t\v\f\u2028\u2029" else c for c in unicodedata.normalize("NFC", text))
    # Cc: control, Cf: invisible format (zero width, direction marks), Cs: halves of characters, Cn/Co: not characters
    kept = "".join(c for c in spaced if unicodedata.category(c) not in ("Cc", "Cf", "Cs", "Cn", "Co"))
    cleaned = " ".join(kept.split())
    if not cleaned:
        raise InstructionError("The instruction is empty. Say what the robots are to do.")
    if len(cleaned) > MAX_TEXT:
        raise InstructionError(
            f"The instruction has {len(cleaned)} characters; {MAX_TEXT} are allowed. Send it as several instructions."
        )
    return cleaned
