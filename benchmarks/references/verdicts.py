"""Results of comparing an estimator with its reference, and tolerances (bars)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

Verdict = Literal["agrees", "worse", "failed", "undecided", "not compared"]

FILTER_BAR = 1e-6  # sigma
COST_BAR = 1e-6  # relative, and absolute below a cost of 1
STEP_BAR = 0.02  # sigma


@dataclass(frozen=True)
class Outcome:
    """Result of an estimator on a recording.

    Attributes:
        estimator: its name.
        verdict: `undecided` if no reference has an answer, `not compared` if no reference for such recordings exists.
        difference: to the reference; sigmas for filters and `causal` (its worst step), relative cost for `batch`.
        note: more about the result, for example the error message.
        steps: number of steps compared one by one (`causal` only).
        steps_off: number of these steps with a difference above the bar.
        unflagged: the same number if the estimate's own check did not report a problem, otherwise 0.
    """

    estimator: str
    verdict: Verdict
    difference: float = 0.0
    note: str = ""
    steps: int = 0
    steps_off: int = 0
    unflagged: int = 0


@dataclass(frozen=True)
class Judged:
    """All outcomes of a recording, and the seconds that they took."""

    seed: int
    number: int
    steps: int
    tags: tuple[str, ...]
    outcomes: list[Outcome]
    seconds: float


def attempt(estimator: Callable[[Recording], Estimate], recording: Recording) -> Estimate | str:
    """Return the estimate, or the error message of a `UserError` or of an exception that should have been one."""
    try:
        return estimator(recording)
    except UserError as error:
        return str(error)
    except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
        return f"{type(error).__name__}: {error}"
