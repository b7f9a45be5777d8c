"""The settings of the exercise (TP4, course ROB312 of ENSTA), by question and by the number of their figure."""

from __future__ import annotations

from typing import NamedTuple

from slamgauge.compare.estimators.registry import CAUSAL, DEAD_RECKONING

EKF, GTSAM = "ekf", "gtsam-batch"
ESTIMATORS = (DEAD_RECKONING, EKF, CAUSAL, GTSAM)


class Question(NamedTuple):
    """A question of the exercise: title, and task in two sentences."""

    title: str
    task: str


class Setting(NamedTuple):
    """A setting: question, number of its figure in the handout (`ring` is ours), shipped scenario, title for tables."""

    question: str
    figure: str
    scenario: str
    title: str


QUESTIONS = {
    "q1": Question(
        "Environment, with known association",
        "The ids of the landmarks are known. The robot drives a short and a long loop with many landmarks, and a long "
        "loop with landmarks near the start only; figure 1.1 is the handout as it is distributed.",
    ),
    "q2": Question(
        "Data association",
        "The ids are unknown: an observation belongs to the landmark of smallest squared Mahalanobis distance if that "
        "is within a gate, and to a new landmark otherwise. Gates of 1 and 100 are compared with 9, and gate 9 is "
        "tried on the three maps of question 1.",
    ),
    "q3": Question(
        "Assumed noise",
        "The filter assumes 0.1, 1, 10 and 2 times the covariances Q and Py of the simulation. The loop is long, the "
        "map is sparse, and the ids are unknown (gate 9).",
    ),
    "q4": Question(
        "Bearing-only",
        "The sensor measures bearings without ranges. A new landmark starts as a ray of several Gaussians, of which "
        "later bearings leave one (undelayed initialisation, FIS).",
    ),
}
_SETTINGS = (
    Setting("q1", "1.1", "tp4-handout", "handout"),
    Setting("q1", "2.1", "q1-short-dense", "short dense"),
    Setting("q1", "2.2", "q1-long-dense", "long dense"),
    Setting("q1", "2.3", "q1-long-sparse", "long sparse"),
    Setting("q2", "2.4", "q2-gate-1", "gate 1"),
    Setting("q2", "2.5", "q2-gate-100", "gate 100"),
    Setting("q2", "2.6", "q2-short-dense", "short dense"),
    Setting("q2", "2.7", "q2-long-dense", "long dense"),
    Setting("q2", "2.8", "q2-long-sparse", "long sparse"),
    Setting("q3", "3.1", "q3-scale-0.1", "scale 0.1"),
    Setting("q3", "3.2", "q3-scale-1", "scale 1"),
    Setting("q3", "3.3", "q3-scale-10", "scale 10"),
    Setting("q3", "3.4", "q3-scale-2", "scale 2"),
    Setting("q4", "4.1", "q4-three-landmarks", "3 landmarks"),
    Setting("q4", "ring", "q4-ring", "ring of 19"),
)
SETTINGS = {each.figure: each for each in _SETTINGS}
