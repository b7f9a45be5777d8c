"""What came of holding an estimator against its referee, and how close counts as the same."""

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
    """An estimator on a recording.

    Attributes:
        estimator: its name.
        verdict: `undecided` where no referee has an answer, `not compared` where there is none for such recordings.
        difference: to the referee; sigmas of filters and causal (its worst step), relative cost of batch.
        note: what else is to be said: the message of one that failed.
        steps: that were compared one by one, and how many of them were off the bar; causal alone has them.
        unflagged: off the bar, in a recording whose estimate did not say so itself.
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
    """All outcomes of a recording, with the seconds that they took."""

    seed: int
    number: int
    steps: int
    tags: tuple[str, ...]
    outcomes: list[Outcome]
    seconds: float


def attempt(estimator: Callable[[Recording], Estimate], recording: Recording) -> Estimate | str:
    """The estimate, or the message of what went wrong: a `UserError`, or what nobody has turned into one."""
    try:
        return estimator(recording)
    except UserError as error:
        return str(error)
    except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
        return f"{type(error).__name__}: {error}"
