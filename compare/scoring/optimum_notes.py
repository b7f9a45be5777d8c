"""Lines under a table: how well the model fits, what the optima leave out, and which figures are in doubt."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.optimum_figures import CHECK_LIMIT, is_in_doubt, unused_observations
from slamgauge.compare.scoring.text_table import interval_cell
from slamgauge.display import counted
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS
from slamgauge.truth import NOBODY, Truth

MARK = "?"  # behind figures that are relative to an optimum in doubt
FIT_LEVEL = 0.95  # of the two-sided chi-square band of the fit

_MARKED = f"figures relative to it are marked {MARK}"


def fit_of_the_model(title: str, optimum: Estimate) -> str | None:
    """chi2/dof of an optimum and its band; outside of that, what it means. None where the optimum does not tell."""
    if optimum.chi_square is None or not optimum.chi_square_dof:
        return None
    dof = optimum.chi_square_dof
    figure = optimum.chi_square / dof
    low, high = (bound / dof for bound in chi2_band(FIT_LEVEL, dof))
    digits = max(2, 1 - math.floor(math.log10(high - low)))  # the band's width has two at least
    verdict = ""
    if figure > high:
        verdict = ", above it: noise is stated too small, or there are outliers"
    elif figure < low:
        verdict = ", below it: noise is stated too large"
    return (
        f"fit of the model: chi2/dof of the {title} {figure:.{digits}f} ({dof} degrees of freedom, "
        f"{100 * FIT_LEVEL:g} % band {low:.{digits}f} to {high:.{digits}f}){verdict}"
    )


def mean_fit(title: str, fit: Interval | None) -> str | None:
    """The same of many runs: mean chi2/dof with its 95 % interval."""
    return None if fit is None else f"fit of the model: chi2/dof of the {title} {interval_cell(fit, '{:.3f}')}"


def left_out(name: str, truth: Truth | None, recording: Recording, optimum: Estimate) -> str | None:
    """How many landmarks and observations an optimum does without; None if it uses all, or does not tell."""
    observations = unused_observations(truth or Truth(), optimum)
    ids = recording.landmark
    if truth is not None and truth.association is not None and (ids is None or truth.misleading is not None):
        ids = truth.association[truth.association != NOBODY]  # which the optima are told
    landmarks = 0 if ids is None else int(np.sum(~np.isin(np.unique(ids), optimum.landmark_ids)))
    if not observations:
        return None
    counts = [counted(landmarks, "landmark")] * (landmarks > 0) + [counted(observations, "observation")]
    why = "" if SENSORS[recording.sensor].places_landmarks else " that bearings alone do not place"
    return f"{name} leaves out {' and '.join(counts)}{why}"


def told_apart(names: Sequence[str], truth: Truth | None) -> str | None:
    """Which observations the optima are told to leave out; None if there are none."""
    misleading = None if truth is None else truth.misleading
    if misleading is None or not misleading.any() or not names:
        return None
    verbs = "is told" if len(names) == 1 else "are told", "runs" if len(names) == 1 else "run"
    without = f"{verbs[1]} without these {int(misleading.sum())}"
    return f"{' and '.join(names)} {verbs[0]} which observations mislead, and {without} (outliers and clutter)"


def misfits(names: Sequence[str]) -> str | None:
    """That optima are none of what has happened, by their residuals; None without names."""
    if not names:
        return None
    which = f"the residuals of {' and '.join(names)} are not those of the stated noise"
    return f"{which}: no optimum of what has happened; {_MARKED.replace('it', 'them')}"


def under_associations(names: Sequence[str]) -> str:
    """That the optima are told no true associations, but those of an estimator."""
    return f"no ids, and no true associations: held against {' and '.join(names)}, with associations right or wrong"


def distance_from_optimum(name: str, check: float | None) -> str | None:
    """That a causal optimum is not what it is taken for; None if it is, or was not checked."""
    if check is None or not is_in_doubt(check):
        return None
    if math.isinf(check):
        return f"{name} has steps whose optimum was not found, or that of the whole recording was not"
    return f"{name} is {check:.2g} sigma from the optimum at a checked step"


def distance_in_runs(name: str, share: float | None) -> str | None:
    """The same of many runs: in which share of them."""
    if not share:
        return None
    off = f"{name} is more than {CHECK_LIMIT:g} sigma from the optimum at a checked step"
    return f"{off} in {share:.1%} of the runs"


def doubt(name: str, check: float | None) -> str | None:
    """The distance of an optimum that others are compared with: what is relative to it is marked."""
    return _with_marks(distance_from_optimum(name, check))


def doubt_in_runs(name: str, share: float | None) -> str | None:
    """The same of many runs."""
    return _with_marks(distance_in_runs(name, share))


def at_places(
    name: str, shares: Mapping[str, float | None], said: Callable[[str, float | None], str | None] = doubt_in_runs
) -> list[str]:
    """What is `said` of an optimum that many runs have at several places: a line for those of equal shares."""
    return placed({place: said(name, share) for place, share in shares.items()})


def placed(said: Mapping[str, str | None]) -> list[str]:
    """What is `said` at several places: a line for those at which it is the same."""
    lines: dict[str, list[str]] = {}
    for place, line in said.items():
        if line is not None:
            lines.setdefault(line, []).append(place)
    return [f"{', '.join(places)}: {line}" for line, places in lines.items()]


def _with_marks(distance: str | None) -> str | None:
    return None if distance is None else f"{distance}: {_MARKED}"
