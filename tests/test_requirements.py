"""The pinned requirements: what each service may install, and where nothing may come from."""

import re
from pathlib import Path

import pytest

REQUIREMENTS = Path(__file__).parents[1] / "requirements"
FILES = sorted(REQUIREMENTS.glob("*.txt"))
HEAVY = re.compile(r"^(torch\w*|opencv[\w-]*|pybullet|triton|nvidia[\w-]*)\b", re.MULTILINE)


def pins(path: Path) -> list[str]:
    """Return the requirements of a file, each in one line."""
    text = re.sub(r"#.*", "", path.read_text()).replace("\\\n", " ")
    return [line for line in text.splitlines() if line.strip()]


def test_there_is_a_file_for_each_service() -> None:
    """So that a container installs only what its service needs."""
    names = {"planner", "scheduler", "robot-agent", "vision", "sim", "cli", "development", "build", "bootstrap"}
    assert {p.stem for p in FILES} == names


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_every_requirement_is_pinned_and_hashed(path: Path) -> None:
    """One version and at least one hash each, and no other option in the file."""
    found = pins(path)
    assert found
    for pin in found:
        assert re.match(r"[a-z0-9._-]+(\[[a-z,]+\])?==\S+ .*--hash=sha256:[0-9a-f]{64}", pin), pin


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_no_file_says_where_to_download(path: Path) -> None:
    """Neither a registry nor a folder of one machine is named: that is for whoever installs to say."""
    assert not re.search(r"://|^-[ef]|--(index|extra|find)|\s/\w", path.read_text(), re.MULTILINE)


@pytest.mark.parametrize("name", ["planner", "scheduler", "robot-agent", "cli"])
def test_light_services_stay_light(name: str) -> None:
    """They install neither torch nor OpenCV nor pybullet."""
    assert HEAVY.findall((REQUIREMENTS / f"{name}.txt").read_text()) == []


def test_heavy_services_have_what_they_need() -> None:
    """The check above would notice these packages if they were there."""
    assert "torch" in HEAVY.findall((REQUIREMENTS / "vision.txt").read_text())
    assert "pybullet" in HEAVY.findall((REQUIREMENTS / "sim.txt").read_text())


def test_development_has_all_of_it_in_the_same_versions() -> None:
    """What is tested is what containers run."""
    development = {pin.split()[0].split("[")[0] for pin in pins(REQUIREMENTS / "development.txt")}
    for path in FILES:
        if path.stem not in ("build", "bootstrap"):
            assert {pin.split()[0].split("[")[0] for pin in pins(path)} <= development, path.stem
