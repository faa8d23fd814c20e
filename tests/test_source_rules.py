"""Rules about the source itself: who may import what, where keys and the environment stand, how large a module is."""

import ast
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
MEMBERS = sorted(p.parent for p in [*ROOT.glob("*/pyproject.toml"), *ROOT.glob("services/*/pyproject.toml")])
HEAVY = {"torch", "opencv-contrib-python-headless", "opencv-python", "pybullet", "open-clip-torch"}
SPEAKS_FOR_OTHERS = {"tests/test_bad_input.py", "tests/test_plain_subscriber.py"}
"""Tests that play a program of another make, which knows Zenoh and nothing of ours."""


@dataclass(frozen=True)
class Module:
    """One Python file of the project."""

    path: Path

    @property
    def name(self) -> str:
        """Its path below the root."""
        return self.path.relative_to(ROOT).as_posix()

    @property
    def is_test(self) -> bool:
        """Whether it is a test or a test's help."""
        return "tests" in self.path.relative_to(ROOT).parts

    @cached_property
    def text(self) -> str:
        """Its source."""
        return self.path.read_text(encoding="utf-8")

    @cached_property
    def tree(self) -> ast.Module:
        """Its syntax tree."""
        return ast.parse(self.text, self.name)


@cache
def modules() -> tuple[Module, ...]:
    """Return every Python file that is in the repository or about to be."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.py"],  # noqa: S607
        cwd=ROOT,
        check=True,
        capture_output=True,
        encoding="utf-8",
    )
    return tuple(Module(ROOT / line) for line in sorted(set(listed.stdout.splitlines())) if (ROOT / line).is_file())


def imports(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield the first part of each absolute import, and its line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name.split(".")[0], node.lineno
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module.split(".")[0], node.lineno


def optional_imports(tree: ast.AST) -> set[int]:
    """Return the lines of imports whose absence the module copes with (`except ModuleNotFoundError`)."""
    return {
        inner.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.Try)
        if any(isinstance(h.type, ast.Name) and h.type.id == "ModuleNotFoundError" for h in node.handlers)
        for statement in node.body
        for inner in ast.walk(statement)
        if isinstance(inner, ast.Import | ast.ImportFrom)
    }


def docstrings(tree: ast.AST) -> set[int]:
    """Return the ids of the nodes that are docstrings or other strings that stand alone."""
    return {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)}


def test_only_the_bus_imports_zenoh() -> None:
    """Services talk of channels and models; how they travel is the bus's business."""
    wrong = [
        f"{m.name}:{line}"
        for m in modules()
        if not m.name.startswith("bus/") and m.name not in SPEAKS_FOR_OTHERS
        for name, line in imports(m.tree)
        if name == "zenoh"
    ]
    assert wrong == []


def test_keys_stand_in_the_channel_table_only() -> None:
    """No other module of the product writes a key of the bus."""
    wrong = [
        f"{m.name}:{node.lineno}"
        for m in modules()
        if not m.is_test and m.name != "schemas/src/muster_schemas/channels.py"
        for tree in [m.tree]
        for said in [docstrings(tree)]
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said
        if node.value.startswith("muster/") or node.value.startswith("/muster/")
    ]
    assert wrong == []


def test_the_environment_is_read_in_settings_only() -> None:
    """Settings are read once, in one place of each package, and handed down."""
    wrong = [
        f"{m.name}:{node.lineno}"
        for m in modules()
        if m.path.name != "settings.py" and not m.is_test
        for node in ast.walk(m.tree)
        if (isinstance(node, ast.Attribute) and node.attr in {"environ", "environb", "getenv", "putenv"})
        or (
            isinstance(node, ast.ImportFrom)
            and node.module == "os"
            and {a.name for a in node.names} & {"environ", "getenv"}
        )
    ]
    assert wrong == []


def test_modules_are_small() -> None:
    """A module of the product has at most 400 lines, any other file 600; whoever needs more has two subjects."""
    wrong = [m.name for m in modules() if len(m.text.splitlines()) > (400 if "src" in m.path.parts else 600)]
    assert wrong == []


def test_modules_are_named_by_their_subject() -> None:
    """Names that say nothing attract everything."""
    vague = {"utils.py", "util.py", "helpers.py", "helper.py", "misc.py", "common.py", "tools.py"}
    assert [m.name for m in modules() if m.path.name in vague] == []


def test_no_work_is_left_lying_in_comments() -> None:
    """What is not done is an issue, not a comment."""
    marks = ("TO" + "DO", "FIX" + "ME", "X" * 3)
    wrong = [
        f"{m.name}:{number}"
        for m in modules()
        for number, line in enumerate(m.text.splitlines(), start=1)
        if any(mark in line.split("#", 1)[-1] for mark in marks) and "#" in line
    ]
    assert wrong == []


def test_no_file_knows_this_machine() -> None:
    """Paths of the machine that a file was written on are of no use on another."""
    here = (str(ROOT) + "/", str(Path.home()) + "/")
    wrong = [m.name for m in modules() if any(path in m.text for path in here)]
    assert wrong == []


def test_every_test_says_what_it_shows() -> None:
    """Each test function has a docstring: the behaviour in one sentence."""
    wrong = [
        f"{m.name}:{node.lineno} {node.name}"
        for m in modules()
        if m.is_test and m.path.name.startswith("test_")
        for node in ast.walk(m.tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name.startswith("test_")
        if not ast.get_docstring(node)
    ]
    assert wrong == []


@cache
def distributions() -> Mapping[str, list[str]]:
    """Return which distributions bring each importable name."""
    return metadata.packages_distributions()


@cache
def declared(member: Path) -> frozenset[str]:
    """Return the names of the distributions that a member's pyproject.toml asks for, optional ones too."""
    project = tomllib.loads((member / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    optional = [r for group in project.get("optional-dependencies", {}).values() for r in group]
    asked = [*project.get("dependencies", []), *optional]
    names = frozenset[str](canonicalize_name(Requirement(r).name) for r in asked)
    ours = {f"muster-{m.name}": m for m in MEMBERS}
    # What schemas and bus need is there wherever they are.
    return names.union(*(declared(ours[name]) for name in names if name in ours))


@pytest.mark.parametrize("member", MEMBERS, ids=lambda p: p.name)
def test_a_member_imports_only_what_it_declares(member: Path) -> None:
    """Each package runs with its own dependencies alone: its container has no others."""
    own = {p.name for p in (member / "src").iterdir()}
    allowed = declared(member)
    if member.name == "bus":
        allowed |= {"pytest"}  # muster_bus.testing is a pytest plugin: only pytest imports it
    wrong = [
        f"{m.name}:{line} imports {name}"
        for m in modules()
        if m.path.is_relative_to(member / "src")
        for optional in [optional_imports(m.tree)]
        for name, line in imports(m.tree)
        if line not in optional and name not in sys.stdlib_module_names and name not in own
        if not {canonicalize_name(d) for d in distributions().get(name, [name])} & allowed
    ]
    assert wrong == []


def needed(distribution: str, seen: set[str]) -> set[str]:
    """Return all that an installed distribution needs, and what that needs in turn."""
    if distribution in seen:
        return seen
    seen.add(distribution)
    try:
        requires = metadata.requires(distribution) or []
    except metadata.PackageNotFoundError:
        return seen
    for text in requires:
        requirement = Requirement(text)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            needed(canonicalize_name(requirement.name), seen)
    return seen


@pytest.mark.parametrize("member", ["planner", "scheduler", "robot-agent"])
def test_light_services_pull_no_heavy_library(member: str) -> None:
    """What plans, schedules or drives a robot needs none of the libraries of vision and the simulator."""
    asked = declared(ROOT / "services" / member)
    pulled = set[str]().union(*(needed(name, set()) for name in asked))
    assert pulled & HEAVY == set()


def test_the_shared_language_stands_alone() -> None:
    """`muster_schemas` imports nothing else of Muster."""
    wrong = [
        f"{m.name}:{line} imports {name}"
        for m in modules()
        if m.name.startswith("schemas/src/")
        for name, line in imports(m.tree)
        if name.startswith("muster_") and name != "muster_schemas"
    ]
    assert wrong == []
