"""What the site's remote models may still cost today, in tokens; in a file, so that a restart does not begin anew.

What a call may cost at most is written down before the call and corrected after it: a planner that dies in between, or
is killed and started in a circle, has spent it. Days are those of UTC. A clock that is set back begins no new day.
"""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Protocol

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .errors import BudgetFileError, BudgetSpentError

_DAY_S = 86_400


class Held(Protocol):
    """Tokens that were set aside for one call."""

    def settle(self, tokens: int) -> None:
        """Count what the call has really cost instead."""
        ...


class Budget(Protocol):
    """Who is asked before every call of a remote model."""

    def hold(self, tokens: int) -> Held:
        """Set aside what a call may cost at most.

        Raises:
            BudgetSpentError: there is not that much left today.

        """
        ...


class _Spent(BaseModel):
    model_config = ConfigDict(extra="forbid")

    day: Annotated[int, Field(ge=0)]
    """Days since 1970."""
    tokens: Annotated[int, Field(ge=0)]


class DailyBudget:
    """The budget of one site.

    Args:
        file: keeps what was spent.
        tokens: a day.
        clock: seconds since 1970.

    """

    def __init__(self, file: Path, tokens: int, clock: Callable[[], float] = time.time) -> None:
        self._file = file
        self._limit = tokens
        self._clock = clock
        self._known: _Spent | None = None

    @property
    def left(self) -> int:
        """Tokens that may still be spent today.

        Raises:
            BudgetFileError: the file cannot be read, so what was spent is not known.

        """
        return max(0, self._limit - self._today().tokens)

    def hold(self, tokens: int) -> "_Hold":
        """Set aside what a call may cost at most; see `Budget.hold`."""
        left = self.left
        if tokens > left:
            raise BudgetSpentError(
                f"The site's budget for remote models, {self._limit} tokens a day, has {left} left, and this may "
                f"need {tokens}. Wait until midnight (UTC), raise MUSTER_PLAN_TOKENS_PER_DAY, or plan with "
                "MUSTER_PLANNER=embedded."
            )
        return _Hold(self, tokens, self._add(tokens).day)

    def correct(self, tokens: int, day: int) -> None:
        """Count more or less for a call of that day."""
        if day == self._today().day:
            self._add(tokens)

    def _today(self) -> _Spent:
        known, today = self._known or self._load(), int(self._clock() // _DAY_S)
        self._known = _Spent(day=today, tokens=0) if today > known.day else known
        return self._known

    def _add(self, tokens: int) -> _Spent:
        """Write down what was spent, then believe it."""
        before = self._today()
        spent = _Spent(day=before.day, tokens=max(0, before.tokens + tokens))
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self._file.parent, prefix=self._file.name)
            with os.fdopen(handle, "wb") as file:
                file.write(spent.model_dump_json().encode())
                file.flush()
                os.fsync(file.fileno())
            Path(name).replace(self._file)
        except OSError as error:
            message = f"What planning has cost cannot be written to {self._file}: {error.strerror}. Make room for it."
            raise BudgetFileError(message) from error
        self._known = spent
        return spent

    def _load(self) -> _Spent:
        try:
            return _Spent.model_validate_json(self._file.read_bytes())
        except FileNotFoundError:
            return _Spent(day=int(self._clock() // _DAY_S), tokens=0)
        except (OSError, ValidationError) as error:
            message = (
                f"What planning has cost today cannot be read from {self._file}. Delete the file if the budget may "
                "begin anew."
            )
            raise BudgetFileError(message) from error


class _Hold:
    def __init__(self, budget: DailyBudget, tokens: int, day: int) -> None:
        self._budget = budget
        self._tokens = tokens
        self._day = day

    def settle(self, tokens: int) -> None:
        self._budget.correct(tokens - self._tokens, self._day)


class Unlimited:
    """For what is started by hand and ends by itself: a command, a measurement, a test."""

    def hold(self, tokens: int) -> "Unlimited":
        """Set nothing aside."""
        del tokens
        return self

    def settle(self, tokens: int) -> None:
        """Count nothing."""
        del tokens
