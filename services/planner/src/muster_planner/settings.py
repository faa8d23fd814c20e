"""What the planner reads from its environment, once."""

import ipaddress
from typing import Annotated

from muster_bus.settings import ServiceSettings
from pydantic import Field, SecretStr, ValidationInfo, field_validator

from .drafting import Limits
from .errors import UnknownPlannerError
from .llm import check_choice


class PlannerSettings(ServiceSettings):
    """Beside the site, router and log: the model, where the REST API listens, and what planning may cost."""

    planner: str = "embedded"
    """`embedded`, or `ollama:` and a model."""
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

    @field_validator("planner")
    @classmethod
    def _known_planner(cls, planner: str) -> str:
        try:
            return check_choice(planner)
        except UnknownPlannerError as error:
            raise ValueError(str(error)) from error

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


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach what listens there."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
