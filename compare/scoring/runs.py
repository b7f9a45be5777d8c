"""The runs of one estimator side by side: what a study keeps of each, as arrays over runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int

# what is kept of every step: errors and sigmas [m, m, rad], NEES, and the NIS with its degrees of freedom
SERIES = (
    "error_x",
    "error_y",
    "error_heading",
    "sigma_x",
    "sigma_y",
    "sigma_heading",
    "nees_pose",
    "nees_position",
    "nees_heading",
    "nis",
    "nis_dof",
)


@dataclass(frozen=True)
class Runs:
    """The stored runs of one estimator that did not fail.

    Attributes:
        run: (R,) numbers of the runs, increasing.
        kind: `filtered` or `smoothed`.
        figures: key (`catalogue.STORED`) to (R,); NaN where a figure is undefined.
        series: name (`SERIES`) to (R, N+1); NaN where undefined.
    """

    run: Int
    kind: str
    figures: dict[str, Float]
    series: dict[str, Float]


class Ates(NamedTuple):
    """Numbers (R,) of an estimator's runs that did not fail, and the ATE [m] of each, NaN where it is undefined."""

    run: Int
    ate_m: Float


def paired(runs: Runs, optimum: Runs) -> tuple[Int, Int]:
    """Rows of the runs that both have."""
    _, ours, theirs = np.intersect1d(runs.run, optimum.run, assume_unique=True, return_indices=True)
    return ours, theirs
