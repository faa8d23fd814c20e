"""Settings of this machine must not reach a test: each says what it needs itself."""

import os

import pytest


@pytest.fixture(autouse=True)
def clean_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take every MUSTER_ variable out of the environment."""
    for name in [n for n in os.environ if n.startswith("MUSTER_")]:
        monkeypatch.delenv(name)
