"""Results of comparisons with references: outcomes, the bars that they must meet, and their table."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

Verdict = Literal["agrees", "worse", "failed", "undecided", "not compared"]

FILTER_BAR = 1e-6  # sigma
COST_BAR = 1e-6  # relative, and absolute below a cost of 1
STEP_BAR = 0.02  # sigma
VERDICTS: tuple[Verdict, ...] = ("agrees", "worse", "failed", "undecided", "not compared")
UNITS = {"batch": "cost", "batch mapped": "landmarks"}  # units of differences; sigmas for all others


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


def attempt(estimator: Callable[[Recording], Estimate], recording: Recording) -> Estimate | str:
    """Return the estimate, or the error message of a `UserError` or of an exception that should have been one."""
    try:
        return estimator(recording)
    except UserError as error:
        return str(error)
    except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
        return f"{type(error).__name__}: {error}"


def table(outcomes: Sequence[Outcome]) -> str:
    """Return a row per estimator: number of recordings per verdict, and the largest finite difference."""
    lines = [f"{'estimator':14}" + "".join(f"{each:>14}" for each in VERDICTS) + f"{'largest difference':>28}"]
    for name in dict.fromkeys(each.estimator for each in outcomes):
        own = [each for each in outcomes if each.estimator == name]
        counts = Counter(each.verdict for each in own)
        largest = max((each.difference for each in own if math.isfinite(each.difference)), default=math.nan)
        row = "".join(f"{counts[each]:14d}" for each in VERDICTS)
        lines.append(f"{name:14}{row}{largest:>14.1e} {UNITS.get(name, 'sigma'):13}".rstrip())
    compared, off, unflagged = (
        sum(getattr(each, key) for each in outcomes) for key in ("steps", "steps_off", "unflagged")
    )
    if compared:
        lines += ["", f"causal steps: {compared}, more than {STEP_BAR} sigma off: {off} ({off / compared:.2%})"]
        lines[-1] += f", of these in estimates without a flag: {unflagged}"
    return "\n".join(lines)
