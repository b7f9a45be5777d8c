"""Adapters of `examples/adapters`: each equals `ekf`, passes `check`, and is short."""

from __future__ import annotations

import re

import numpy as np
import pytest

from slamgauge.compare.checks.examination import check_estimator
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import ekf_slam

from .conftest import EXAMPLES

pytestmark = pytest.mark.slow

ADAPTERS = {"octave_course": "estimate", "ntnu_class": "Ntnu", "own_class": "Wrapper"}
LIMIT = "standing-robot-in-noise"  # a limit of the textbook method


@pytest.mark.parametrize("name", ADAPTERS)
def test_an_adapter_equals_our_ekf_and_passes_every_check(name: str):
    estimator = load_estimators([f"mine={EXAMPLES}/adapters/{name}.py:{ADAPTERS[name]}"])["mine"]
    recording = simulate(load_scenario("q1-short-dense", ["start=sampled"]), 3)[1]
    mine, ours = estimator(recording), ekf_slam(recording)
    assert np.abs(mine.poses - ours.poses).max() < 1e-9
    assert np.abs(np.asarray(mine.pose_covs) - np.asarray(ours.pose_covs)).max() < 1e-9
    order = [mine.landmark_ids.tolist().index(each) for each in ours.landmark_ids]
    assert np.abs(mine.landmarks[order] - ours.landmarks).max() < 1e-9
    verdicts = check_estimator("mine", estimator)
    assert [each.name for each in verdicts if each.is_failure] == []
    assert [each.name for each in verdicts if each.limit_of_method] == [LIMIT]


@pytest.mark.parametrize("name", ADAPTERS)
def test_an_adapter_is_short(name: str):
    assert len((EXAMPLES / "adapters" / f"{name}.py").read_text(encoding="utf-8").splitlines()) <= 40


def test_the_page_shows_an_adapter_with_numbers_of_its_lines():
    page = (EXAMPLES.parent / "docs/your_filter.md").read_text(encoding="utf-8")
    shown = page.split("```python\n")[1].split("```")[0]
    file = (EXAMPLES / "adapters/own_class.py").read_text(encoding="utf-8")
    code, ours = (re.sub(r"  # .*", "", each) for each in (shown, file))
    assert ours.endswith(f"\n{code}")
