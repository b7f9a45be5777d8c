"""What an optimum says of itself: whether it is one, whether the model fits, what it leaves out."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.defined import mean
from slamgauge.compare.scoring.landmark_identity import NOBODY
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

CHECK_LIMIT = 0.05  # sigmas: a causal optimum that is farther from hindsight's at the end is in doubt


def is_in_doubt(check: float | None) -> bool:
    """Whether an optimum was checked, and is too far from hindsight's for figures against it to stand unmarked."""
    return check is not None and check > CHECK_LIMIT


def share_of_doubt(checks: Float) -> float | None:
    """Share of the runs with a check (R,), NaN where there is none, whose optimum is in doubt."""
    return mean(np.where(np.isnan(checks), np.nan, checks > CHECK_LIMIT))


# --- what the catalogue names --------------------------------------------------------------------


def check_sigma(_truth: Truth, _recording: Recording, estimate: Estimate) -> float | None:
    """The check that a causal optimum comes with; infinite where there was nothing to hold it against."""
    return estimate.optimum_check


def chi_square_per_dof(_truth: Truth, _recording: Recording, estimate: Estimate) -> float | None:
    """How large the residuals are; None without a degree of freedom."""
    if estimate.chi_square is None or not estimate.chi_square_dof:
        return None
    return estimate.chi_square / estimate.chi_square_dof


def observations_left_out(_truth: Truth, _recording: Recording, estimate: Estimate) -> int | None:
    """How many observations an optimum does not use; what a filter rejects is another figure."""
    if estimate.chi_square is None or estimate.association is None:
        return None
    return int(np.sum(estimate.association == NOBODY))
