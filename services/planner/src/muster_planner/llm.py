"""The port to language models: one request in, one draft of a plan out.

`MUSTER_PLANNER` chooses the adapter (`embedded`, `ollama:llama3.1`, `openai:gpt-4o`, `anthropic:...`); each is imported
only when it is chosen, since their libraries take long to load.
"""

from collections.abc import AsyncGenerator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Protocol, runtime_checkable

from muster_schemas.mission import Reason
from muster_schemas.plan import Plan
from muster_schemas.robot import RobotCard
from muster_schemas.skills import Catalogue

from .budget import Budget, Unlimited
from .errors import UnknownPlannerError

if TYPE_CHECKING:
    from .adapters.remote import ChatServer


@dataclass(frozen=True)
class Feedback:
    """What is wrong with the draft before, for a repair."""

    reasons: tuple[Reason, ...]
    raw: str
    """The refused answer as the model wrote it."""
    plan: Plan | None = None
    """The refused plan; None if the answer was no plan at all."""


@dataclass(frozen=True)
class PlanRequest:
    """Everything that a model may know: nothing about robots, objects or skills stands in a prompt's text."""

    text: str
    roster: tuple[RobotCard, ...]
    objects: tuple[str, ...]
    catalogue: Catalogue
    letters: Mapping[str, str] = field(default_factory=dict[str, str])
    """Robot type -> the letter that the site's file gives it (`E`); types may be missing."""
    background: str | None = None
    """What a model that reads more than an instruction should know, for the rest of a mission."""
    feedback: Feedback | None = None
    timeout_s: float = 60.0
    """An answer that takes longer is a `ModelTimeoutError`."""
    max_tokens: int = 2048
    """Of the answer; a longer one is a `TruncatedAnswerError`."""


@dataclass(frozen=True)
class PlanDraft:
    """A model's answer: a plan that no gate has seen yet, or why it refuses; exactly one of the two."""

    plan: Plan | None
    refusal: str | None
    raw: str
    """The answer as the model wrote it."""
    latency_s: float
    tokens_in: int
    tokens_out: int

    def __post_init__(self) -> None:
        if (self.plan is None) == (self.refusal is None):
            raise ValueError("a draft is either a plan or a refusal")


class PlanningModel(Protocol):
    """A language model that drafts plans. One call runs at a time; it must not block the event loop."""

    async def plan(self, request: PlanRequest) -> PlanDraft:
        """Return a draft for the request; a cancelled call has stopped computing when it raises.

        Raises:
            PlanningError: there is none; see `errors`.

        """
        ...


@dataclass(frozen=True)
class TextAnswer:
    """What a model wrote, whole."""

    text: str
    latency_s: float
    tokens_in: int
    tokens_out: int


@runtime_checkable
class TextModel(Protocol):
    """A model that also writes text of no fixed form; the embedded one, trained for plans alone, is none."""

    async def complete(self, chat: Sequence[Mapping[str, str]], *, timeout_s: float, max_tokens: int) -> TextAnswer:
        """Return the answer to a chat (`role`, `content`).

        Raises:
            PlanningError: there is none; see `errors`.

        """
        ...


REMOTE: Final = ("ollama", "openai", "anthropic")
"""Adapters of models behind a server; the model's name follows after a colon."""


def check_choice(choice: str) -> str:
    """Return the choice unchanged if there is an adapter for it.

    Raises:
        UnknownPlannerError: there is none.

    """
    kind, _, name = choice.partition(":")
    if choice == "embedded" or (kind in REMOTE and name.strip()):
        return choice
    raise UnknownPlannerError(
        f"there is no planner {choice[:80]!r}; take 'embedded', or 'ollama:', 'openai:' or 'anthropic:' and a model, "
        "such as 'ollama:llama3.1'"
    )


@asynccontextmanager
async def open_model(choice: str, budget: Budget | None = None) -> AsyncGenerator[PlanningModel]:
    """Load the model that `choice` names, and free it at the end.

    Args:
        choice: `embedded`, or the name of a server's API, a colon and a model; `settings.access` says where the
            server is and which key opens it.
        budget: asked before every call of a remote model; None: it may cost what it costs.

    Raises:
        UnknownPlannerError: there is no such adapter.
        ModelMissingError: the embedded model's files are not there.
        KeyRefusedError: the API takes no request without a key, and none is set.

    """
    kind, _, name = check_choice(choice).partition(":")
    if kind == "embedded":
        from .embedded import open_embedded  # noqa: PLC0415 (loads the inference library)

        async with open_embedded() as embedded:
            yield embedded
        return
    from .adapters.remote import RemoteModel  # noqa: PLC0415 (needs this module)
    from .settings import access  # noqa: PLC0415 (needs this module)

    opened: AbstractAsyncContextManager[ChatServer]
    match kind:
        case "ollama":
            from .adapters.ollama import open_ollama  # noqa: PLC0415 (loads the client)

            opened = open_ollama(name, access("ollama"))
        case "openai":
            from .adapters.openai import open_openai  # noqa: PLC0415 (loads the client)

            opened = open_openai(name, access("openai"))
        case _:
            from .adapters.anthropic import open_anthropic  # noqa: PLC0415 (loads the client)

            opened = open_anthropic(name, access("anthropic"))
    async with opened as server:
        yield RemoteModel(server, budget or Unlimited())
