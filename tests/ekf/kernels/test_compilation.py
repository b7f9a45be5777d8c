"""Compiled code: cached on disk, announced, and working without a writable folder."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.reference.installed_copy import first_and_later_use

pytestmark = pytest.mark.slow

PROGRAM = (
    "import numpy as np; from slamgauge.ekf import SlamFilter;"
    "s = SlamFilter('position', np.zeros(3), np.eye(3)); s.predict([1, 0, 0], np.eye(3)); print(s.pose_cov[0, 0])"
)
ONE_KERNEL = (
    "import numpy as np; from slamgauge.ekf.kernels.belief import allocate_belief;"
    "from slamgauge.ekf.kernels.prediction import predict; belief = allocate_belief(1)._replace(size=3);"
    "belief.cov[:] = np.eye(5); predict(belief, np.array([1.0, 0, 0]), np.eye(3)); print(belief.cov[0, 0])"
)


def test_first_use_is_announced_and_later_ones_load_from_disk(tmp_path: Path) -> None:
    first, second = first_and_later_use(tmp_path, PROGRAM, "corrections.update_standard")
    assert "compiling" in first.stderr
    assert second.stderr == ""
    assert first.stdout == second.stdout == "2.0\n"


def test_filters_work_without_a_writable_folder() -> None:
    """A folder below a device cannot exist, for any user."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": "/dev/null/cache"}
    command = [sys.executable, "-c", ONE_KERNEL]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "2.0\n"


def test_settings_load_no_compiler() -> None:
    program = "import sys, slamgauge.ekf.settings as a; print(a.Association().gate, 'numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "9.0 False\n"
