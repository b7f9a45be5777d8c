"""The import of slamgauge limits BLAS to one thread, unless somebody else has chosen."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from slamgauge.blas_threads import VARIABLES


@pytest.mark.parametrize(
    ("statements", "chosen", "expected"),
    [
        ("import slamgauge", {}, "1"),
        ("import slamgauge", {"OPENBLAS_NUM_THREADS": "2"}, "2"),
        ("import numpy, slamgauge", {}, "None"),
        ("import slamgauge.compare.cli.main", {}, "1"),
    ],
)
def test_the_import_sets_one_thread(statements: str, chosen: dict[str, str], expected: str) -> None:
    free = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    program = f"import os\n{statements}\nprint(os.environ.get('OPENBLAS_NUM_THREADS'))"
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=free | chosen, check=True, capture_output=True, text=True)
    assert done.stdout.strip() == expected


@pytest.mark.parametrize("chosen", [{}, {"OPENBLAS_NUM_THREADS": "2"}])
def test_estimators_run_with_one_thread_after_an_import_of_numpy(chosen: dict[str, str]) -> None:
    free = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    program = """if True:
        import numpy, scipy.linalg, threadpoolctl
        from slamgauge.blas_threads import one_blas_thread
        threads = lambda: [library["num_threads"] for library in threadpoolctl.threadpool_info()]
        before = threads()
        with one_blas_thread():
            inside = threads()
        print(inside == [1] * len(before), inside == before, threads() == before, len(before) > 0)
    """
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=free | chosen, check=True, capture_output=True, text=True)
    several = os.cpu_count() != 1
    expected = [not chosen or not several, bool(chosen) or not several, True, True]
    assert done.stdout.split() == [str(each) for each in expected]
