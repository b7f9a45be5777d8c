"""Without GTSAM everything that does not need it runs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
BLOCKED = ROOT / "tests/without_gtsam"


def without_gtsam(*words: str) -> subprocess.CompletedProcess[str]:
    """Run Python with `words`; it and its child processes cannot import gtsam."""
    path = os.pathsep.join([str(BLOCKED), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True
    )


def test_the_three_estimators_of_gtsam_name_an_alternative_and_all_others_run(tmp_path: Path) -> None:
    words = ["run", "q1-short-dense", "--set", "trajectory.duration=3", "--estimators"]
    words += ["ekf,causal,batch,robust-batch,fixed-lag,isam2,gtsam-batch", "--no-report", "--wide"]
    done = without_gtsam("-m", "slamgauge", *words, "--out", str(tmp_path / "run"))
    for name, other in {"gtsam-batch": "batch", "fixed-lag": "causal", "isam2": "causal"}.items():
        reason = f"estimator {name}: needs GTSAM, which cannot be imported (there is no gtsam); use {other}"
        assert reason in done.stdout
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    rows = {line.split()[0]: line.split()[1] for line in done.stdout.splitlines() if line}
    assert all(rows[name] == "filtered" for name in ("ekf", "causal"))
    assert all(rows[name] == "smoothed" for name in ("batch", "robust-batch"))
