"""Our filters of known association, each beside its textbook version."""

from __future__ import annotations

import pytest
from textbook import textbook_ekf, textbook_fej_ekf, textbook_iekf, textbook_oc_ekf, textbook_riekf

from slamgauge.ekf import ekf_slam, fej_ekf, iekf, oc_ekf, riekf

PAIRS = [
    pytest.param(ekf_slam, textbook_ekf, id="ekf"),
    pytest.param(fej_ekf, textbook_fej_ekf, id="fej-ekf"),
    pytest.param(oc_ekf, textbook_oc_ekf, id="oc-ekf"),
    pytest.param(iekf, textbook_iekf, id="iekf"),
    pytest.param(riekf, textbook_riekf, id="riekf"),
]
