"""Stored runs of one estimator in a study, as arrays over runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float, Int

# stored for every step: errors and sigmas [m, m, rad], NEES, and the NIS with its degrees of freedom
SERIES = (
    *("error_x", "error_y", "error_heading", "sigma_x", "sigma_y", "sigma_heading"),
    *("nees_pose", "nees_position", "nees_heading", "nis", "nis_dof"),
)


@dataclass(frozen=True)
class Runs:
    """Runs of one estimator without the failed ones.

    Attributes:
        run: (R,) numbers of the runs, increasing.
        kind: `filtered` or `smoothed`.
        figures: arrays (R,) by key (`catalogue.STORED`); NaN where undefined.
        series: arrays (R, N+1) by name (`SERIES`); NaN where undefined.
    """

    run: Int
    kind: str
    figures: dict[str, Float]
    series: dict[str, Float]


def paired_figures(key: str, runs: Runs, other: Runs) -> tuple[Float, Float]:
    """Return a figure (C,) of the common runs of two estimators."""
    ours, theirs = paired(runs, other)
    return runs.figures[key][ours], other.figures[key][theirs]


def paired(runs: Runs, optimum: Runs) -> tuple[Int, Int]:
    """Return the rows of the common runs in `runs` and in `optimum`."""
    _, ours, theirs = np.intersect1d(runs.run, optimum.run, assume_unique=True, return_indices=True)
    return ours, theirs
