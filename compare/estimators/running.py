"""Running an estimator: what it prints and raises kept apart, what it returns checked."""

from __future__ import annotations

import sys
from contextlib import nullcontext, redirect_stdout
from dataclasses import dataclass
from time import perf_counter
from typing import cast

import numpy as np

from slamgauge.compare.estimators.isolated_process import OverdueError
from slamgauge.compare.estimators.loading import entry_behind, spent_by
from slamgauge.compare.estimators.user_code import reason_of
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording

FARTHEST = 1e12  # m, rad: beyond any map; squares of errors are numbers still


@dataclass(frozen=True)
class StoredEstimate:
    """An estimate that was made elsewhere, in the place of an estimator."""

    estimate: Estimate

    def __call__(self, _recording: Recording, /) -> Estimate:
        """As it lies, of whatever recording."""
        return self.estimate


def run_estimator(name: str, estimator: Estimator, recording: Recording) -> tuple[Estimate, float]:
    """The estimate, checked against the recording, and the seconds that it took.

    Args:
        name: what error texts call it.
        estimator: one of `load_estimators`, or any callable.
        recording: what it sees.

    Raises:
        UserError: the estimator raised, or what it returned does not fit the recording; an `OverdueError` if it was
            not done in time.
    """
    entry = entry_behind(estimator)
    is_ours = entry is not None and entry.role != "user"
    start = perf_counter()
    try:
        # standard output is for results; ours are silent, and threads of a study must not redirect it
        with nullcontext() if is_ours else redirect_stdout(sys.stderr):
            estimate = cast("object", estimator(recording))
    except (Exception, SystemExit) as error:
        if is_ours and not isinstance(error, UserError):
            raise
        reason = str(error) if is_ours else reason_of(error)
        kind = OverdueError if isinstance(error, OverdueError) else UserError
        raise kind(f"estimator {name}: {reason}") from error
    spent = spent_by(estimator)
    seconds = perf_counter() - start if spent is None else spent.seconds
    return _checked(name, estimate, recording), seconds


def _checked(name: str, estimate: object, recording: Recording) -> Estimate:
    if not isinstance(estimate, Estimate):
        raise UserError(f"estimator {name}: returned a {type(estimate).__name__}; return a slamgauge.Estimate")
    if len(estimate.poses) != recording.steps + 1:
        raise UserError(
            f"estimator {name}: returned {len(estimate.poses)} poses; "
            f"return {recording.steps + 1}, one for the start and one for every step"
        )
    far = np.abs(estimate.poses).max(axis=1) > FARTHEST
    if far.any():
        step = int(far.argmax())
        pose = ", ".join(f"{each:.3g}" for each in estimate.poses[step])
        raise UserError(f"estimator {name}: has diverged, its pose of step {step} is ({pose}); mend it and run again")
    if estimate.association is not None and len(estimate.association) != len(recording.observation):
        raise UserError(
            f"estimator {name}: association has {len(estimate.association)} entries; "
            f"return {len(recording.observation)}, one for every observation"
        )
    return estimate
