"""What the command reads from the environment."""

import os
import shlex
from functools import cached_property
from pathlib import Path

from muster_bus.settings import ServiceSettings
from muster_schemas.site import Site, SiteError, load_site
from pydantic import Field, SecretStr, ValidationError

from .errors import CliError


class CliSettings(ServiceSettings):
    """Settings of `muster`; the ones that every service has, and where the operator's interface is."""

    url: str | None = Field(default=None, description="of the planner; left out: the site that is up on this machine")
    token: SecretStr | None = None

    @cached_property
    def site(self) -> Site:
        """The site's file, checked."""
        return read_site(self.site_file)


def read_settings() -> CliSettings:
    """Return the settings.

    Raises:
        CliError: a variable has a value that it cannot have.

    """
    try:
        return CliSettings()
    except ValidationError as error:
        problems = "; ".join(f"MUSTER_{'_'.join(map(str, e['loc'])).upper()}: {e['msg']}" for e in error.errors())
        raise CliError(f"These settings cannot be used: {problems}", exit_code=2) from error


def read_site(path: Path) -> Site:
    """Return the site in `path`.

    Raises:
        CliError: there is none, or it breaks a rule.

    """
    try:
        return load_site(path)
    except SiteError as error:
        raise CliError(str(error), exit_code=2) from error


def editor() -> list[str]:
    """Return the command that opens the user's editor."""
    return shlex.split(os.environ.get("VISUAL") or os.environ.get("EDITOR") or "vi")


def inherited_environment() -> dict[str, str]:
    """Return the environment that child processes get beside their own settings."""
    return dict(os.environ)
