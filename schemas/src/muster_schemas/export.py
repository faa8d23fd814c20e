"""Writes what is generated from the models: `docs/channels.md` and the JSON Schemas for robots in other languages.

`python -m muster_schemas.export ROOT` writes; with `--check` it changes nothing and exits 1 if a file differs.
"""

import json
import sys
from pathlib import Path

from pydantic import BaseModel

from .channels import CHANNELS, Kind


def channels_page() -> str:
    """Return the page that lists every key."""
    lines = [
        "# Channels",
        "",
        "Generated from `muster_schemas/channels.py` by `make schemas`; do not edit. Payloads are UTF-8 JSON unless a",
        "row says otherwise; each model's JSON Schema lies in `schemas/json/`. Ids match `^[a-z0-9_-]{1,64}$`.",
        "",
        "| key | model | kind | rate | owner | what |",
        "|---|---|---|---|---|---|",
    ]
    for c in CHANNELS:
        model = "" if c.kind is Kind.LIVELINESS else c.model.__name__
        if c.reply:
            model += f" -> {c.reply.__name__}"
        if c.binary:
            model = f"JPEG + {model}"
        rate = f"{c.rate_hz:g} Hz" if c.rate_hz else ""
        lines.append(f"| `{c.template}` | {model} | {c.kind} | {rate} | {c.owner} | {c.what} |")
    lines += ["", "Kinds:", ""]
    lines += [
        "- event: each message counts. state: the last value is kept, and its owner answers a query on the key.",
        "- command: someone is to do something. stream: periodic, only the newest counts.",
        "- query: request and reply; a refusal is an error reply with an `ErrorReply`.",
        "- liveliness: a token, no payload.",
        "",
    ]
    return "\n".join(lines)


def files() -> dict[str, str]:
    """Return every generated file: path below the project's root -> text."""
    models: dict[str, type[BaseModel]] = {}
    for channel in CHANNELS:
        if channel.kind is not Kind.LIVELINESS:
            models[channel.model.__name__] = channel.model
        if channel.reply:
            models[channel.reply.__name__] = channel.reply
    out = {"docs/channels.md": channels_page()}
    for name, model in sorted(models.items()):
        out[f"schemas/json/{name}.json"] = json.dumps(model.model_json_schema(by_alias=True), indent=2) + "\n"
    return out


def main(argv: list[str]) -> int:
    """Write or check the generated files below the root given in `argv`."""
    root = Path(next((a for a in argv if not a.startswith("-")), "."))
    stale = [p for p, text in files().items() if not (root / p).is_file() or (root / p).read_text() != text]
    if "--check" in argv:
        for path in stale:
            sys.stderr.write(f"{path} is not what the models say; run `make schemas`\n")
        return int(bool(stale))
    for path in stale:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(files()[path])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
