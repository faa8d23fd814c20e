"""Why a language model gave no plan, split by who must act.

    PlanningError
    ├── SetupError              whoever runs the site acts
    │   ├── UnknownPlannerError     MUSTER_PLANNER says something that does not exist
    │   ├── ServerMissingError      the model's server cannot be reached (it may come back: worth another try)
    │   ├── KeyRefusedError         the server does not take the key, or wants one
    │   ├── ModelMissingError       the server, or the package, does not have the model
    │   ├── BudgetSpentError        the site's budget for remote models is used up for today
    │   └── BudgetFileError         what it has cost so far can be neither read nor written
    ├── ModelBusyError          too many requests, or too much to do: the server says when to come back
    └── AnswerError             the model could not do it now; the operator says it shorter or sends it again
        ├── ModelTimeoutError       no answer within the time that is left for the mission
        ├── TruncatedAnswerError    the answer reached the token limit before its end
        └── UnusableAnswerError     the answer is no plan and no refusal

Adapters map their library's exceptions onto these (`raise ... from exc`); every message says what to do.
"""


class PlanningError(Exception):
    """A language model gave no plan."""

    code = "planning_error"
    """Names the kind of error to programs: the code of the reason of a rejected mission."""


class SetupError(PlanningError):
    """Whoever runs the site must act."""

    code = "planner_not_set_up"


class UnknownPlannerError(SetupError):
    """`MUSTER_PLANNER` names no adapter."""

    code = "unknown_planner"


class ServerMissingError(SetupError):
    """The model's server cannot be reached."""

    code = "model_server_missing"


class KeyRefusedError(SetupError):
    """The server does not take the key, or there is none."""

    code = "model_key_refused"


class BudgetSpentError(SetupError):
    """The site's budget for remote models does not allow this call."""

    code = "token_budget_spent"


class BudgetFileError(SetupError):
    """What remote models have cost today is not known."""

    code = "token_budget_unknown"


class ModelMissingError(SetupError):
    """The model is not there."""

    code = "model_missing"


class ModelBusyError(PlanningError):
    """The server has too much to do, or this key has asked too often."""

    code = "model_busy"

    def __init__(self, message: str, *, retry_after_s: float | None = None) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s
        """When the server wants to be asked again; None: it does not say."""


class AnswerError(PlanningError):
    """The model was asked and did not come up with a usable answer."""

    code = "no_answer"

    def __init__(self, message: str, *, raw: str = "", tokens_in: int = 0, tokens_out: int = 0) -> None:
        super().__init__(message)
        self.raw = raw
        """What the model said, as far as it came."""
        self.tokens_in = tokens_in
        self.tokens_out = tokens_out


class ModelTimeoutError(AnswerError):
    """No answer within the request's `timeout_s`."""

    code = "model_timeout"


class TruncatedAnswerError(AnswerError):
    """The answer reached the request's `max_tokens` before its end."""

    code = "answer_truncated"


class UnusableAnswerError(AnswerError):
    """The answer is neither a plan nor a refusal."""

    code = "answer_unusable"
