"""The settings of the exercise (TP4, course ROB312 of ENSTA), by question and by the number of their figure."""

from __future__ import annotations

from typing import NamedTuple

from slamgauge.compare.estimators.registry import CAUSAL, DEAD_RECKONING

EKF, GTSAM = "ekf", "gtsam-batch"
FILTERS = (DEAD_RECKONING, EKF)  # they receive the recording
OPTIMA = (CAUSAL, GTSAM)  # they receive the true noise and associations


class Setting(NamedTuple):
    """A setting: number of its figure in the handout (`ring` is ours), shipped scenario, and title for tables."""

    figure: str
    scenario: str
    title: str


class Question(NamedTuple):
    """A question of the exercise: title, task in two sentences, and settings."""

    title: str
    task: str
    settings: tuple[Setting, ...]


QUESTIONS = {
    "q1": Question(
        "Environment, with known association",
        "The ids of the landmarks are known. The robot drives a short and a long loop with many landmarks, and a long "
        "loop with landmarks near the start only; figure 1.1 is the handout as it is distributed.",
        (
            Setting("1.1", "tp4-handout", "handout"),
            Setting("2.1", "q1-short-dense", "short dense"),
            Setting("2.2", "q1-long-dense", "long dense"),
            Setting("2.3", "q1-long-sparse", "long sparse"),
        ),
    ),
    "q2": Question(
        "Data association",
        "The ids are unknown: an observation belongs to the landmark of smallest squared Mahalanobis distance if that "
        "is within a gate, and to a new landmark otherwise. Gates of 1 and 100 are compared with 9, and gate 9 is "
        "tried on the three maps of question 1.",
        (
            Setting("2.4", "q2-gate-1", "gate 1"),
            Setting("2.5", "q2-gate-100", "gate 100"),
            Setting("2.6", "q2-short-dense", "short dense"),
            Setting("2.7", "q2-long-dense", "long dense"),
            Setting("2.8", "q2-long-sparse", "long sparse"),
        ),
    ),
    "q3": Question(
        "Assumed noise",
        "The filter assumes 0.1, 1, 10 and 2 times the covariances Q and Py of the simulation. The loop is long, the "
        "map is sparse, and the ids are unknown (gate 9).",
        (
            Setting("3.1", "q3-scale-0.1", "scale 0.1"),
            Setting("3.2", "q3-scale-1", "scale 1"),
            Setting("3.3", "q3-scale-10", "scale 10"),
            Setting("3.4", "q3-scale-2", "scale 2"),
        ),
    ),
    "q4": Question(
        "Bearing-only",
        "The sensor measures bearings without ranges. A new landmark starts as a ray of several Gaussians, of which "
        "later bearings leave one (undelayed initialisation, FIS).",
        (
            Setting("4.1", "q4-three-landmarks", "3 landmarks"),
            Setting("ring", "q4-ring", "ring of 19"),
        ),
    ),
}
SETTINGS = {each.figure: each for question in QUESTIONS.values() for each in question.settings}
