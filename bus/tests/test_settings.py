"""What a process reads from its environment."""

from pathlib import Path

import pytest
from muster_bus.settings import RouterSettings, ServiceSettings, child_environment, is_loopback, read
from pydantic import ValidationError


@pytest.fixture(autouse=True)
def clean_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the variables of this machine away."""
    for name in ("SITE_FILE", "CONNECT", "LISTEN", "DATA_DIR", "LOG_LEVEL"):
        monkeypatch.delenv(f"MUSTER_{name}", raising=False)


def test_without_variables_everything_is_on_this_machine() -> None:
    """The default is the default site, on loopback."""
    settings = read(ServiceSettings)
    assert settings.connect == read(RouterSettings).listen == ("tcp/127.0.0.1:7447",)
    assert settings.site_file == Path("sites/yard.yaml")
    assert settings.data_dir == Path(".muster")


def test_several_routers_stand_with_commas(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second one is for when the first fails."""
    monkeypatch.setenv("MUSTER_CONNECT", "tcp/router-1:7447, tcp/[::1]:7448")
    assert read(ServiceSettings).connect == ("tcp/router-1:7447", "tcp/[::1]:7448")


@pytest.mark.parametrize(
    "wrong",
    ["", ",", "router-1:7447", "tcp/router-1", "tcp/:7447", "udp/router-1:7447", "tcp/a:7447/x", "tcp/a b:7447"],
)
def test_what_is_no_endpoint_ends_the_process_with_its_name(
    wrong: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The line names the variable; the exit code is the one for wrong settings."""
    monkeypatch.setenv("MUSTER_CONNECT", wrong)
    with pytest.raises(SystemExit) as caught:
        read(ServiceSettings)
    assert caught.value.code == 78
    assert capsys.readouterr().err.startswith("MUSTER_CONNECT: ")


def test_settings_do_not_change() -> None:
    """They are read once and handed down."""
    with pytest.raises(ValidationError, match="frozen"):
        read(ServiceSettings).log_level = "debug"  # pyright: ignore[reportAttributeAccessIssue]


def test_a_child_gets_only_the_settings_that_it_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    """No variable of Muster leaks into a child; all others are as here."""
    monkeypatch.setenv("MUSTER_TOKEN", "secret")
    monkeypatch.setenv("OTHER", "1")
    child = child_environment({"MUSTER_CONNECT": "tcp/127.0.0.1:1"})
    assert {k: v for k, v in child.items() if k.startswith("MUSTER_")} == {"MUSTER_CONNECT": "tcp/127.0.0.1:1"}
    assert child["OTHER"] == "1"


@pytest.mark.parametrize(
    ("endpoint", "loopback"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tcp/localhost:7447", True),
        ("tcp/[::1]:7447", True),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/router:7447", False),
    ],
)
def test_loopback_is_told_from_the_network(endpoint: str, *, loopback: bool) -> None:
    """Only what stays on this machine needs no warning."""
    assert is_loopback(endpoint) is loopback
