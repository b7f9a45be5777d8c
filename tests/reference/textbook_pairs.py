"""Our filters with known association, each with its textbook version."""

from __future__ import annotations

import pytest

from slamgauge.ekf import ekf_slam, fej_ekf, iekf, oc_ekf, riekf, textbook_ekf
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference.textbook import student_t_ekf, textbook_fej_ekf, textbook_iekf, textbook_oc_ekf, textbook_riekf


def ekf_of_textbook(recording: Recording, tails: float | None = None) -> Estimate:
    """Run the textbook EKF, with `tails` the version that weighs observations."""
    return textbook_ekf(recording) if tails is None else student_t_ekf(recording, tails)


PAIRS = [
    pytest.param(ekf_slam, ekf_of_textbook, id="ekf"),
    pytest.param(fej_ekf, textbook_fej_ekf, id="fej-ekf"),
    pytest.param(oc_ekf, textbook_oc_ekf, id="oc-ekf"),
    pytest.param(iekf, textbook_iekf, id="iekf"),
    pytest.param(riekf, textbook_riekf, id="riekf"),
]
