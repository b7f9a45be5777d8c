"""Comparisons of estimators with references: outcomes, their table, and filters compared with their textbook forms.

Differences of filters are in sigmas of the reference: the largest of |d_i| / sigma_i and of |s_i - sigma_i| / sigma_i
over poses and their components. A lower limit of the sigmas makes the bar at least `SPACINGS` spacings of doubles at
the position: a coordinate of 100 km has no digits for 1e-6 of a sigma of 0.01 mm.

The textbook filters start at the origin, which changes only their rounding. They run a second time in a turned frame:
the difference of both runs shows how many digits they lose.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np

from slamgauge.arrays import Float
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import pose_rotation, wrap
from tests.reference.given import given
from tests.reference.textbook import PAIRS

Verdict = Literal["agrees", "worse", "failed", "undecided", "not compared"]

FILTER_BAR = 1e-6  # sigma
SPACINGS = 16
TURN = 1.0  # rad, of the second run
COST_BAR = 1e-6  # relative, and absolute below a cost of 1
STEP_BAR = 0.02  # sigma
VERDICTS = get_args(Verdict)
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


# --- filters ---------------------------------------------------------------------------------------


class Path(NamedTuple):
    """Poses (N+1, 3) relative to the prior's mean position, and sigmas (N+1, 3) of the additive error."""

    poses: Float
    sigmas: Float


def judge_filters(recording: Recording) -> list[Outcome]:
    """Return an outcome for each of `PAIRS`."""
    if recording.sensor == "bearing":  # rays have no textbook form: the filters must run
        notes = {name: attempt(ours, recording) for name, (ours, _) in PAIRS.items()}
        return [
            Outcome(name, "failed", math.inf, note) if isinstance(note, str) else Outcome(name, "not compared")
            for name, note in notes.items()
        ]
    return [judge_filter(recording, name) for name in PAIRS]


def judge_filter(recording: Recording, name: str) -> Outcome:
    """Compare a filter with its textbook form, which must not lose digits, on a recording with ranges and ids."""
    estimate = attempt(PAIRS[name][0], recording)
    reference, turned = (_textbook(recording, name, turn) for turn in (0.0, TURN))
    if reference is None or turned is None:
        return Outcome(name, "undecided", math.inf, "the textbook form has no answer")
    lost = float(differences(turned, reference, recording).max())
    if isinstance(estimate, str):
        return Outcome(name, "failed" if lost <= FILTER_BAR else "undecided", math.inf, estimate)
    apart = differences(_path(estimate, np.append(recording.prior_mean[:2], 0.0)), reference, recording)
    largest = float(apart.max())
    if largest <= FILTER_BAR:
        return Outcome(name, "agrees", largest)
    if not lost <= FILTER_BAR:
        return Outcome(name, "undecided", largest, f"the textbook form loses digits: {lost:.1e} sigma")
    return Outcome(name, "worse", largest, f"from step {np.argmax(~(apart <= FILTER_BAR))} on")


def _textbook(recording: Recording, name: str, turn: float) -> Path | None:
    """Run the textbook filter from the origin in a frame turned by `turn` [rad]; None where it has no answer."""
    T = pose_rotation(turn)
    mean = np.array([0.0, 0.0, wrap(recording.prior_mean[2] + turn)])
    moved = replace(recording, prior_mean=mean, prior_cov=T @ recording.prior_cov @ T.T)
    with np.errstate(all="ignore"):
        estimate = attempt(PAIRS[name][1], moved)
    return None if isinstance(estimate, str) else _path(estimate, np.append(mean[:2], turn))


def _path(estimate: Estimate, origin: Float) -> Path:
    """Return the path of an estimate relative to an origin (3,) and in its frame."""
    T = pose_rotation(origin[2])
    poses = (estimate.poses - origin) @ T
    poses[:, 2] = wrap(poses[:, 2])
    variances = np.diagonal(T.T @ given(estimate.pose_covs) @ T, axis1=1, axis2=2)
    return Path(poses, np.sqrt(np.maximum(variances, 0.0)))


def differences(ours: Path, reference: Path, recording: Recording) -> Float:
    """Return the largest difference of each step (N+1,) in sigmas of the reference."""
    farthest = np.abs(reference.poses[:, :2]).max(axis=1) + np.abs(recording.prior_mean[:2]).max()
    magnitude = np.column_stack([farthest, farthest, np.full(len(farthest), np.pi)])
    sigma = np.maximum(reference.sigmas, SPACINGS / FILTER_BAR * np.spacing(magnitude))
    apart = ours.poses - reference.poses
    apart[:, 2] = wrap(apart[:, 2])
    apart, wider = np.abs(apart) / sigma, np.abs(ours.sigmas - reference.sigmas) / sigma
    return np.maximum(apart, wider).max(axis=1)
