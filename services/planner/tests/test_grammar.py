"""The grammar lets through what the site can do and nothing else."""

import re
from pathlib import Path

import pytest
from muster_planner.grammar import plan_grammar
from muster_planner.short_names import SiteNames
from muster_planner.surroundings import Surroundings
from muster_schemas.site import load_site
from muster_schemas.skills import PAPER_CATALOGUE

YARD = Surroundings.of_file(load_site(Path(__file__).resolve().parents[3] / "sites" / "yard.yaml"))

_TOKEN = re.compile(r'"((?:[^"\\]|\\.)*)"|(\[[^\]]*\])|([a-z][a-z0-9-]*)|(\{\d+,\d+\}|[()|*+?])|\s+')


def as_expression(grammar: str) -> re.Pattern[str]:
    """Turn a grammar without recursion into a regular expression, to try texts against it."""
    rules = dict(line.split(" ::= ", 1) for line in grammar.splitlines())
    done: dict[str, str] = {}

    def expand(name: str) -> str:
        if name not in done:
            parts: list[str] = []
            for literal, chars, rule, sign in _TOKEN.findall(rules[name]):
                if rule:
                    parts.append(expand(rule))
                elif chars or sign:
                    parts.append(chars or sign)
                elif literal:
                    parts.append(re.escape(literal.replace("\\n", "\n").replace('\\"', '"')))
            done[name] = f"(?:{''.join(parts)})"
        return done[name]

    return re.compile(expand("root"))


EXPRESSION = as_expression(plan_grammar(SiteNames(YARD.roster, YARD.objects, YARD.catalogue, YARD.letters)))


@pytest.mark.parametrize(
    "answer",
    [
        "refuse there is no truck 7 here",
        "a go E1 T1 @ soil1",
        "a home all",
        "a dig E2\nb dump E2 @ soil2 < a\nc go T1 T3 @ puddle1 < a b",
        "a avoid T* @ puddle1 puddle2\nb go T:2 @ rock1 < a\nc tip T:2 @ rock1 < b",
    ],
)
def test_what_the_site_can_do_is_let_through(answer: str) -> None:
    """Plans and refusals of every shape fit."""
    assert EXPRESSION.fullmatch(answer)


@pytest.mark.parametrize(
    "answer",
    [
        "",
        "a go E4 @ soil1",
        "a go E1 @ soil3",
        "a go E1",
        "a home E1 @ soil1",
        "a dig T1 @ soil1",
        "a tip E1",
        "a dig all",
        "a fly E1 @ soil1",
        "a go T:4 @ soil1",
        "a go E1 E1 @ soil1",
        "a home E1 < b\nb go E1 @ soil1",
        "b home E1",
        "a home E1\nc home E2",
        "refuse",
    ],
)
def test_what_the_site_cannot_do_is_kept_out(answer: str) -> None:
    """Unknown robots, objects and verbs, wrong types, too many robots and cycles do not fit."""
    assert not EXPRESSION.fullmatch(answer)


def test_a_site_without_objects_can_still_be_told_to_go_home() -> None:
    """Verbs that need an object are left out, the others stay."""
    expression = as_expression(plan_grammar(SiteNames(YARD.roster, [], PAPER_CATALOGUE)))
    assert expression.fullmatch("a home all\nb dig E1")
    assert not expression.fullmatch("a go E1 @ soil1")


def test_a_site_without_robots_refuses_everything() -> None:
    """There is nobody to plan for."""
    expression = as_expression(plan_grammar(SiteNames([], YARD.objects, PAPER_CATALOGUE)))
    assert expression.fullmatch("refuse there are no robots")
    assert not expression.fullmatch("a home all")


def test_a_thousand_robots_keep_the_grammar_small() -> None:
    """The grammar grows with the roster, not with its square."""
    robot = YARD.roster[0]
    roster = [robot.model_copy(update={"robot_id": f"robot_excavator_{n}"}) for n in range(1000)]
    grammar = plan_grammar(SiteNames(roster, YARD.objects, PAPER_CATALOGUE))
    assert len(grammar) < 100_000
