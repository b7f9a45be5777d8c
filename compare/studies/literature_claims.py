"""Claims of publications about filters, in the form of the exercise's claims (`claim_list`).

A new claim is an entry of `CLAIMS`, a new setting an entry of `SETTINGS`. A filter is called consistent if its NEES
is within a factor `SAME` of that of the causal optimum in the same run, and inconsistent if it is above.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.aggregation import late_means
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.studies.claim_list import (
    LESS,
    MORE,
    SAME,
    Claim,
    ClaimSet,
    Figure,
)

APART, NEAR, CLOSE = 2.0, 1.4, 1.15  # limits (`Claim.limit`): filters that differ much, a little, hardly
ALIKE, ABOVE, BELOW = (1.0 / SAME, SAME), (SAME, math.inf), (0.0, 1.0 / SAME)
RING = ("q4-ring", "trajectory.duration=63")  # one loop
UNCERTAIN = ("bailey-2006", "prior.variances=[0, 0, 0.03046]")  # heading at the start to 10 degrees
SETTINGS: dict[str, tuple[str, ...]] = {
    "heading-known": ("bailey-2006", "motion.sigma_yaw_rate_deg=0"),
    "heading-1deg": ("bailey-2006", "prior.variances=[0, 0, 0.0003046]"),
    "heading-10deg": UNCERTAIN,
    "stabilising-noise": (*UNCERTAIN, "assumed.motion_scale=2"),
    "huang-2010": ("huang-2010",),
    "ukfm-slam2d": ("ukfm-slam2d", "trajectory.duration=1000"),
    "stationary": ("stationary", "trajectory.duration=200"),
    "ring-rays": (*RING, "initialisation=fis"),
    "ring-inverse-depth": (*RING, "initialisation=inverse-depth"),
    "ring-delayed": (*RING, "initialisation=delayed"),
}
SOURCES = {
    "bailey2006": "Bailey, Nieto, Guivant, Stevens, Nebot 2006, Consistency of the EKF-SLAM Algorithm, IROS",
    "huang2010": "Huang, Mourikis, Roumeliotis 2010, Observability-based Rules for Designing Consistent EKF SLAM "
    "Estimators, IJRR 29(5)",
    "castellanos2007": "Castellanos, Martinez-Cantin, Tardos, Neira 2007, Robocentric Map Joining: Improving the "
    "Consistency of EKF-SLAM, Robotics and Autonomous Systems 55(1)",
    "barrau2015": "Barrau, Bonnabel 2015, An EKF-SLAM Algorithm with Consistency Properties, arXiv 1510.06263",
    "zhang2017": "Zhang, Wu, Song, Huang, Dissanayake 2017, Convergence and Consistency Analysis for a 3-D "
    "Invariant-EKF SLAM, IEEE Robotics and Automation Letters 2(2)",
    "brossard2020": "Brossard, Barrau, Bonnabel 2020, A Code for Unscented Kalman Filtering on Manifolds (UKF-M), ICRA",
    "julier2001": "Julier, Uhlmann 2001, A Counter Example to the Theory of Simultaneous Localization and Map "
    "Building, ICRA",
    "sola2005": "Sola, Monin, Devy, Lemaire 2005, Undelayed Initialization in Bearing Only SLAM, IROS",
    "sola2012": "Sola, Vidal-Calleja, Civera, Montiel 2012, Impact of Landmark Parametrization on Monocular EKF-SLAM "
    "with Points and Lines, IJCV 97(3)",
    "civera2008": "Civera, Davison, Montiel 2008, Inverse Depth Parametrization for Monocular SLAM, IEEE T-RO 24(5)",
}


def _nees(runs: Runs) -> Float:
    return late_means(runs.series["nees_pose"])


def _position_nees(runs: Runs) -> Float:
    return late_means(runs.series["nees_position"])


def _heading_nees(runs: Runs) -> Float:
    return late_means(runs.series["nees_heading"])


def _nis(runs: Runs) -> Float:
    return np.divide(runs.figures["nis_total"], runs.figures["nis_dof_total"])


def _heading_sigma(runs: Runs) -> Float:
    return runs.series["sigma_heading"][:, -1]


def _ate(runs: Runs) -> Float:
    return runs.figures["ate_m"]


def _map_error(runs: Runs) -> Float:
    return runs.figures["landmark_rmse_m"]


FIGURES: dict[str, Callable[[Runs], Float]] = {
    "NEES": _nees,  # mean of the pose over the steps from the 11th on
    "position NEES": _position_nees,
    "heading NEES": _heading_nees,
    "NIS": _nis,  # over its degrees of freedom
    "last heading sigma": _heading_sigma,
    "ATE": _ate,
    "map error": _map_error,  # RMS of the landmarks at the end
}


def claim(
    name: str, sentence: str, what: str, ratio: tuple[str, str], asserted: tuple[float, float], limit: float = APART
) -> Claim:
    """Return a claim about the ratio of a figure of two estimators.

    Args:
        name: key of the source, and a word for the claim.
        sentence: the claim of the source, shortened.
        what: a figure of `FIGURES`.
        ratio: numerator and denominator as ESTIMATOR@SETTING; without a setting, that of the numerator.
        asserted: range of the ratio, both ends excluded.
        limit: see `Claim`.
    """
    read = FIGURES[what]
    (above, _, setting), (below, _, other) = (each.partition("@") for each in ratio)
    low, high = asserted
    within = f"> {low:.3g}" if high == math.inf else f"< {high:.3g}" if not low else f"within {low:.3g} and {high:g}"
    hypothesis = f"{what} of {ratio[0]} / of {ratio[1]} {within}"
    figures = Figure(setting, read, above), (Figure(other or setting, read, below),)
    return Claim(name, sentence, hypothesis, *figures, asserted, limit, SOURCES[name.partition("-")[0]])


CLAIMS = (
    claim(
        "bailey2006-known",
        "with known heading EKF-SLAM is consistent",
        "position NEES",
        ("ekf@heading-known", "causal"),
        ALIKE,
        CLOSE,
    ),
    claim(
        "bailey2006-small",
        "with a small heading uncertainty it is consistent",
        "heading NEES",
        ("ekf@heading-1deg", "causal"),
        ALIKE,
    ),
    claim(
        "bailey2006-large",
        "with a large one it becomes optimistic",
        "heading NEES",
        ("ekf@heading-10deg", "causal"),
        ABOVE,
    ),
    claim(
        "bailey2006-grows",
        "the inconsistency grows with the heading uncertainty",
        "heading NEES",
        ("ekf@heading-10deg", "ekf@heading-1deg"),
        MORE,
    ),
    claim(
        "bailey2006-undetected",
        "the innovations do not show it",
        "NIS",
        ("ekf@heading-10deg", "riekf"),
        ALIKE,
        CLOSE,
    ),
    claim(
        "bailey2006-iterated",
        "iterated updates do not improve it",
        "heading NEES",
        ("iekf@heading-10deg", "ekf"),
        (1.0 / SAME, math.inf),
    ),
    claim(
        "bailey2006-stabilising",
        "stabilising noise does not remove it",
        "heading NEES",
        ("ekf@stabilising-noise", "causal"),
        ABOVE,
    ),
    claim(
        "huang2010-ekf",
        "the EKF is inconsistent",
        "NEES",
        ("ekf@huang-2010", "causal"),
        ABOVE,
    ),
    claim(
        "huang2010-spurious",
        "it gains heading information that does not exist",
        "last heading sigma",
        ("ekf@huang-2010", "causal"),
        BELOW,
        NEAR,
    ),
    claim(
        "huang2010-fej",
        "the FEJ-EKF is consistent",
        "NEES",
        ("fej-ekf@huang-2010", "causal"),
        ALIKE,
        CLOSE,
    ),
    claim(
        "huang2010-oc",
        "the OC-EKF is consistent",
        "NEES",
        ("oc-ekf@huang-2010", "causal"),
        ALIKE,
        CLOSE,
    ),
    claim(
        "huang2010-accuracy",
        "the OC-EKF is more accurate than the EKF",
        "ATE",
        ("oc-ekf@huang-2010", "ekf"),
        LESS,
    ),
    claim(
        "huang2010-robocentric",
        "and more consistent than robocentric mapping",
        "NEES",
        ("oc-ekf@huang-2010", "robocentric-ekf"),
        LESS,
    ),
    claim(
        "castellanos2007-consistency",
        "a robocentric map is more consistent than a world-centric one",
        "NEES",
        ("robocentric-ekf@huang-2010", "ekf"),
        LESS,
    ),
    claim(
        "castellanos2007-map",
        "and more accurate",
        "map error",
        ("robocentric-ekf@huang-2010", "ekf"),
        LESS,
    ),
    claim(
        "barrau2015-unobservable",
        "the right-invariant EKF gains no information in unobservable directions",
        "last heading sigma",
        ("riekf@ukfm-slam2d", "causal"),
        ALIKE,
        CLOSE,
    ),
    claim(
        "barrau2015-consistency",
        "it is consistent",
        "NEES",
        ("riekf@ukfm-slam2d", "causal"),
        ALIKE,
        CLOSE,
    ),
    claim(
        "barrau2015-accuracy",
        "it is more accurate than the EKF",
        "ATE",
        ("riekf@ukfm-slam2d", "ekf"),
        LESS,
    ),
    claim(
        "zhang2017-robocentric",
        "the right-invariant EKF is more accurate than the robocentric one",
        "ATE",
        ("riekf@huang-2010", "robocentric-ekf"),
        LESS,
        CLOSE,
    ),
    claim(
        "zhang2017-fej",
        "the right-invariant EKF is more accurate than the FEJ-EKF",
        "ATE",
        ("riekf@huang-2010", "fej-ekf"),
        LESS,
        CLOSE,
    ),
    claim(
        "brossard2020-sigma-points",
        "right-invariant sigma points are as consistent as the right-invariant EKF",
        "NEES",
        ("riukf@ukfm-slam2d", "riekf"),
        ALIKE,
        CLOSE,
    ),
    claim(
        "julier2001-stationary",
        "a robot at rest gains heading information in the EKF",
        "last heading sigma",
        ("ekf@stationary", "causal"),
        BELOW,
    ),
    claim(
        "zhang2017-stationary",
        "it gains none in the right-invariant EKF",
        "last heading sigma",
        ("riekf@stationary", "causal"),
        ALIKE,
        CLOSE,
    ),
    claim(
        "sola2005-undelayed",
        "undelayed rays lose no accuracy against delayed initialisation",
        "ATE",
        ("ekf@ring-rays", "ekf@ring-delayed"),
        (0.0, SAME),
    ),
    claim(
        "civera2008-consistency",
        "inverse depth is consistent",
        "NEES",
        ("ekf@ring-inverse-depth", "causal"),
        ALIKE,
    ),
    claim(
        "civera2008-undelayed",
        "undelayed inverse depth loses no accuracy against delayed initialisation",
        "ATE",
        ("ekf@ring-inverse-depth", "ekf@ring-delayed"),
        (0.0, SAME),
    ),
    claim(
        "sola2012-parametrization",
        "inverse depth is more consistent than sums of points",
        "NEES",
        ("ekf@ring-inverse-depth", "ekf@ring-rays"),
        LESS,
    ),
)

LITERATURE = ClaimSet(SETTINGS, CLAIMS)
