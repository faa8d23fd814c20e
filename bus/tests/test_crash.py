"""Where a process may be told to kill itself."""

import os
import signal
from collections.abc import Iterator

import pytest
from muster_bus import crash
from muster_bus.settings import ServiceSettings
from pydantic import ValidationError


@pytest.fixture
def killed(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """Provide the signals that this process would have sent itself; afterwards nobody is told of places."""
    signals: list[int] = []

    def note(_pid: int, number: int) -> None:
        signals.append(number)

    monkeypatch.setattr(os, "kill", note)
    yield signals
    crash.on_passing(None)


def test_nothing_happens_unless_it_is_asked_for(killed: list[int]) -> None:
    """By default a place is only passed."""
    assert ServiceSettings().crash_at is None
    crash.point("commit")
    assert killed == []


@pytest.mark.parametrize(("where", "passed"), [("3", 3), ("committed:2", 4), ("send:1", None)])
def test_the_process_is_killed_at_the_place_that_was_named(where: str, passed: int | None, killed: list[int]) -> None:
    """A number counts all places, a name and a number only those of that name; once is enough."""
    crash.on_passing(crash.kill_at(where))
    for number, name in enumerate(["commit", "committed", "commit", "committed", "commit", "committed"], 1):
        crash.point(name)
        assert killed == ([signal.SIGKILL] if passed is not None and number >= passed else [])


@pytest.mark.parametrize("wrong", ["", "0", "commit", "commit:0", "commit:1:2", "-1", "Commit:1"])
def test_what_names_no_place_is_refused(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The settings say so; nothing starts."""
    monkeypatch.setenv("MUSTER_CRASH_AT", wrong)
    with pytest.raises(ValidationError):
        ServiceSettings()
