"""What every process reads from its environment, once. Subclass `ServiceSettings` for a service's own."""

import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, TypeVar, cast

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from .crash import CRASH_AT

BAD_SETTINGS_EXIT = 78
"""Exit code of a process whose settings or site file cannot be used (EX_CONFIG)."""

_ENDPOINT = re.compile(r"tcp/(\[[0-9a-fA-F:.]+\]|[^\s/:\[\]]+):[0-9]{1,5}")


def _split(value: object) -> object:
    """Read `tcp/a:7447,tcp/b:7447` from an environment variable."""
    if isinstance(value, str):
        return tuple(part.strip() for part in value.split(",") if part.strip())
    return value


def _check_endpoint(value: str) -> str:
    if not _ENDPOINT.fullmatch(value):
        raise ValueError(f"{value[:80]!r} is no endpoint; write it like tcp/127.0.0.1:7447")
    return value


def is_loopback(endpoint: str) -> bool:
    """Return whether only this machine reaches the endpoint."""
    host = endpoint.removeprefix("tcp/").rpartition(":")[0].strip("[]")
    return host in ("localhost", "::1") or host.startswith("127.")


Endpoint = Annotated[str, AfterValidator(_check_endpoint)]
Endpoints = Annotated[tuple[Endpoint, ...], NoDecode, BeforeValidator(_split), Field(min_length=1)]
LogLevel = Literal["debug", "info", "warning", "error"]


class ServiceSettings(BaseSettings):
    """Where the site, the router and the data are."""

    model_config = SettingsConfigDict(env_prefix="MUSTER_", frozen=True, extra="ignore")

    site_file: Path = Path("sites/yard.yaml")
    connect: Endpoints = ("tcp/127.0.0.1:7447",)
    """Routers; the first that answers is used, the others when it fails."""
    data_dir: Path = Path(".muster")
    log_level: LogLevel = "info"
    crash_at: Annotated[str, Field(pattern=rf"^{CRASH_AT.pattern}$")] | None = None
    """For tests: the place at which the process kills itself, see `muster_bus.crash`."""


class RouterSettings(BaseSettings):
    """Where the router listens; loopback unless told otherwise."""

    model_config = SettingsConfigDict(env_prefix="MUSTER_", frozen=True, extra="ignore")

    listen: Endpoints = ("tcp/127.0.0.1:7447",)
    log_level: LogLevel = "info"


S = TypeVar("S", bound=BaseSettings)


def read(kind: type[S]) -> S:
    """Return the settings from the environment, or end the process with one line a variable that says what is wrong."""
    try:
        return kind()
    except ValidationError as error:
        for problem in error.errors():
            name = "_".join(str(cast("object", part)) for part in problem["loc"][:1]).upper()
            sys.stderr.write(f"MUSTER_{name}: {problem['msg']}\n")
        raise SystemExit(BAD_SETTINGS_EXIT) from error


def child_environment(settings: Mapping[str, str]) -> dict[str, str]:
    """Return this process's environment for a child, with these MUSTER_ variables and no others."""
    return {**{k: v for k, v in os.environ.items() if not k.startswith("MUSTER_")}, **settings}
