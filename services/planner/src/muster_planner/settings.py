"""What the planner reads from its environment, once.

Keys stand in the variables in which their vendors' own programs look for them. They are never logged and stand in no
message; `SecretStr` keeps them out of representations.
"""

import ipaddress
from typing import Annotated

from muster_bus.settings import ServiceSettings
from pydantic import Field, SecretStr, ValidationInfo, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from .adapters.remote import Access
from .drafting import Limits
from .errors import UnknownPlannerError
from .llm import check_choice


class PlannerSettings(ServiceSettings):
    """Beside the site, router and log: the model, where the REST API listens, and what planning may cost."""

    planner: str = "embedded"
    """`embedded`, or `ollama:`, `openai:` or `anthropic:` and a model."""
    host: Annotated[str, Field(min_length=1)] = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    """0: any free one; the log says which."""
    token: Annotated[SecretStr | None, Field(validate_default=True)] = None
    """Of the operators; must be set if `host` is not loopback."""
    plan_queue: Annotated[int, Field(ge=1, le=10_000)] = 64
    """Instructions that may wait for the model; more are told to come back later."""
    plan_time_s: Annotated[float, Field(gt=0, le=3600)] = Limits.time_s
    """Of model time that one instruction may cost, repairs included."""
    plan_tokens: Annotated[int, Field(ge=100, le=10_000_000)] = Limits.tokens
    """In and out, that one instruction may cost, repairs included."""
    plan_tokens_per_day: Annotated[int, Field(ge=0, le=10**12)] = 2_000_000
    """In and out, that all instructions may cost together with a remote model, dry runs included."""

    @field_validator("planner")
    @classmethod
    def _known_planner(cls, planner: str) -> str:
        try:
            kind = check_choice(planner).partition(":")[0]
        except UnknownPlannerError as error:
            raise ValueError(str(error)) from error
        server = access(kind)
        if server.secret is None and (kind == "anthropic" or (kind == "openai" and server.url is None)):
            raise ValueError(f"{planner[:80]!r} wants a key; set {kind.upper()}_API_KEY")
        return planner

    @field_validator("token")
    @classmethod
    def _token_beyond_loopback(cls, token: SecretStr | None, info: ValidationInfo) -> SecretStr | None:
        host = info.data.get("host", "")
        if token is not None and (not token.get_secret_value().isascii() or not token.get_secret_value().strip()):
            raise ValueError("must be visible ASCII characters; make one with `openssl rand -hex 32`")
        if token is None and not is_loopback(host):
            raise ValueError(
                f"must be set, because MUSTER_HOST={host} can be reached from other machines; "
                "make one with `openssl rand -hex 32`, or leave MUSTER_HOST at 127.0.0.1"
            )
        return token

    @property
    def limits(self) -> Limits:
        """What planning one instruction may cost."""
        return Limits(time_s=self.plan_time_s, tokens=self.plan_tokens)


class ModelServers(BaseSettings):
    """Where models' servers are and what opens them."""

    model_config = SettingsConfigDict(frozen=True, extra="ignore", env_ignore_empty=True)

    ollama_host: str | None = None
    openai_base_url: str | None = None
    openai_api_key: SecretStr | None = None
    anthropic_base_url: str | None = None
    anthropic_api_key: SecretStr | None = None


def access(api: str) -> Access:
    """Return where the server of an API (`ollama`, `openai`, `anthropic`) is, and its key."""
    servers = ModelServers()
    match api:
        case "ollama":
            return Access(url=servers.ollama_host)
        case "openai":
            return Access(url=servers.openai_base_url, key=servers.openai_api_key)
        case _:
            return Access(url=servers.anthropic_base_url, key=servers.anthropic_api_key)


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach what listens there."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
