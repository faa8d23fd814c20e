"""The container set-up fits the rest: same router settings, every robot of the site, nothing open by default."""

from pathlib import Path
from typing import Any, cast

import yaml
from muster_bus.testing import SITE_FILE
from muster_bus.zenohd import config_file
from muster_schemas.site import load_site

ROOT = Path(__file__).parents[1]
Services = dict[str, dict[str, Any]]


def services() -> Services:
    """Return the services of compose.yaml."""
    return cast("Services", yaml.safe_load((ROOT / "compose.yaml").read_text())["services"])


def test_the_routers_of_both_kinds_have_the_same_settings() -> None:
    """`make schemas` writes zenohd's file from the Python router's settings."""
    assert (ROOT / "router" / "zenohd.json5").read_text() == config_file()


def test_each_robot_of_the_default_site_has_its_container() -> None:
    """A robot without an agent would never be found."""
    robots = {s["environment"]["MUSTER_ROBOT_ID"] for s in services().values() if "MUSTER_ROBOT_ID" in str(s)}
    assert robots == {r.id for r in load_site(SITE_FILE).robots}


def test_ports_are_open_to_this_machine_only() -> None:
    """Whoever wants more says so in a file of their own."""
    ports = [port for service in services().values() for port in service.get("ports", [])]
    assert ports
    assert all(port.startswith("127.0.0.1:") for port in ports)


def test_our_containers_are_held_short() -> None:
    """They come back after a crash, have limits, may drain, and have no rights that they do not need."""
    for name, service in services().items():
        assert service["restart"] == "unless-stopped", name
        assert service["deploy"]["resources"]["limits"]["memory"], name
        if "build" in service:
            assert service["read_only"], name
            assert service["cap_drop"] == ["ALL"], name
            assert service["stop_grace_period"] == "20s", name


def test_each_service_has_a_dockerfile_with_a_user_and_a_health_check() -> None:
    """None of them runs as root, and each installs its own pinned requirements only."""
    for folder in sorted((ROOT / "services").iterdir()):
        if not (folder / "pyproject.toml").exists():
            continue
        text = (folder / "Dockerfile").read_text()
        assert "\nUSER muster\n" in text, folder
        assert "\nHEALTHCHECK " in text, folder
        assert f"--require-hashes -r requirements/build.txt -r requirements/{folder.name}.txt" in text, folder
