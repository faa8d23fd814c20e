"""The GBNF grammar that holds the embedded model to the plan language, built from what is on the site now.

Every answer that it lets through has known robots, objects and verbs, the right type for each skill, no more robots
than there are, and waits only for lines above (so no cycle). Refusing is always possible.
"""

from collections.abc import Iterable, Sequence

from muster_schemas.skills import ObjectNeed, Skill

from .plan_language import label
from .short_names import Kind, SiteNames

MAX_LINES = 26
"""Labels of one letter; a longer plan is beyond what the model is taught, and the answer then ends early."""

_MAX_OBJECTS = 8
_MAX_LISTED = 60
"""Robots that a list may name one by one in order; more of a type would make the grammar slow to build."""


def plan_grammar(names: SiteNames, *, may_refuse: bool = True) -> str:
    """Return the grammar's text; its root is either a refusal or lines a, b, c, ...

    Without `may_refuse` it is lines only, unless the site can do nothing at all.
    """
    rules: dict[str, str] = {"refusal": r'"refuse " [^\n]{1,200}'}
    acts = [*_common_acts(names, rules), *_typed_acts(names, rules)]
    if not acts:
        return f"root ::= refusal\nrefusal ::= {rules['refusal']}\n"
    rules["act"] = " | ".join(acts)
    if names.objects:
        rules["object"] = " | ".join(_quoted(o) for o in names.objects)
        rules["objects"] = f'" @ " object (" " object){{0,{_MAX_OBJECTS - 1}}}'
    for n in range(MAX_LINES):
        waits = f' (" <" (" " [a-{label(n - 1)}])+)?' if n else ""
        onward = rf' ("\n" line-{label(n + 1)})?' if n + 1 < MAX_LINES else ""
        rules[f"line-{label(n)}"] = f'"{label(n)} " act{waits}{onward}'
    body = "".join(f"{name} ::= {rule}\n" for name, rule in rules.items())
    return f"root ::= {'refusal | ' if may_refuse else ''}line-a\n{body}"


def _common_acts(names: SiteNames, rules: dict[str, str]) -> Iterable[str]:
    if not names.kinds:
        return
    listed = [short for kind in names.kinds for short in kind.robots]
    groups = [_group(kind) for kind in names.kinds]
    rules["anyone"] = " | ".join([_quoted("all"), *groups, _list("any", listed, rules)])
    for skill in names.common:
        act = _act(skill, "anyone", has_objects=bool(names.objects))
        if act:
            yield act


def _typed_acts(names: SiteNames, rules: dict[str, str]) -> Iterable[str]:
    for kind in names.kinds:
        skills = names.skills_of(kind)
        if not skills:
            continue
        letter = kind.letter.lower()
        rules[f"kind-{letter}"] = " | ".join([_group(kind), _list(letter, list(kind.robots), rules)])
        for skill in skills:
            act = _act(skill, f"kind-{letter}", has_objects=bool(names.objects))
            if act:
                yield act


def _act(skill: Skill, robots: str, *, has_objects: bool) -> str | None:
    """Return one verb with its robots and objects; None if it needs an object and there is none."""
    start = f"{_quoted(skill.verb + ' ')} {robots}"
    if skill.objects is ObjectNeed.NONE:
        return start
    if not has_objects:
        return None if skill.objects is ObjectNeed.REQUIRED else start
    return f"{start} objects" if skill.objects is ObjectNeed.REQUIRED else f"{start} objects?"


def _group(kind: Kind) -> str:
    """Return the rule for `T*`, `T:1`, ... up to as many as there are."""
    counts = " | ".join(_quoted(f"{kind.letter}:{n}") for n in range(1, min(len(kind.robots), 20) + 1))
    return f"{_quoted(f'{kind.letter}*')} | {counts}"


def _list(prefix: str, robots: Sequence[str], rules: dict[str, str]) -> str:
    """Add rules for a list of robots that names each at most once, in order, and return the first one's name."""
    if len(robots) > _MAX_LISTED:
        rules[f"one-{prefix}"] = " | ".join(_quoted(r) for r in robots)
        rules[f"{prefix}-0"] = f'one-{prefix} (" " one-{prefix}){{0,{_MAX_LISTED - 1}}}'
        return f"{prefix}-0"
    for n, robot in enumerate(robots):
        later = f' (" " {prefix}-{n + 1})?' if n + 1 < len(robots) else ""
        skip = f" | {prefix}-{n + 1}" if n + 1 < len(robots) else ""
        rules[f"{prefix}-{n}"] = f"{_quoted(robot)}{later}{skip}"
    return f"{prefix}-0"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
