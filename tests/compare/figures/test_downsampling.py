from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from slamgauge.compare.figures.downsampling import MOST_POSES, MOST_VALUES, even_rows, extreme_rows


def test_a_short_run_keeps_all_points() -> None:
    np.testing.assert_array_equal(even_rows(7), np.arange(7))
    np.testing.assert_array_equal(extreme_rows(np.arange(7.0)), np.arange(7))


def test_a_long_path_keeps_its_ends() -> None:
    rows = even_rows(1_000_001)
    assert len(rows) == MOST_POSES
    assert (rows[0], rows[-1]) == (0, 1_000_000)
    assert np.diff(rows).max() <= 11


def test_a_long_curve_keeps_its_peaks_its_ends_and_its_gaps() -> None:
    values = np.sin(np.arange(1_000_003.0))
    values[[4_321, 700_000]] = 9.0, -9.0
    values[500_000:504_500] = np.nan
    rows = extreme_rows(values)
    assert len(rows) <= MOST_VALUES + 2
    assert {0, 4_321, 700_000, 1_000_002} <= {*rows.tolist()}
    assert np.isnan(values[rows]).any()


@pytest.mark.skipif(sys.platform != "linux", reason="the test reads the peak memory from /proc")
def test_a_path_of_a_thousand_loops_is_drawn_in_pieces() -> None:
    """In one piece it needs more than twice the memory: Agg stores all pixels on a line."""
    program = """
import sys
from tempfile import TemporaryDirectory
import numpy, matplotlib
from pathlib import Path
from matplotlib.figure import Figure
from slamgauge.compare.figures.plot_style import PRINT
from slamgauge.compare.figures.plot_style import Sheet, printed_on, save_printed

def draw(poses):
    with matplotlib.rc_context(PRINT | chosen), printed_on(Sheet(formats=["png"])), TemporaryDirectory() as folder:
        figure = Figure(figsize=(7.0, 4.6))
        figure.subplots().plot(numpy.cos(poses), numpy.sin(poses))
        save_printed(figure, Path(folder) / "figure")
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])

chosen = {"agg.path.chunksize": 0} if sys.argv[1] == "at once" else {}
before = draw(numpy.arange(10.0))
print((draw(numpy.linspace(0.0, 2000.0 * numpy.pi, 100_000)) - before) / 1e3)
"""
    piece_by_piece, at_once = (
        float(subprocess.run([sys.executable, "-c", program, how], check=True, capture_output=True).stdout)
        for how in ("piece by piece", "at once")
    )
    assert 2.0 < piece_by_piece < at_once / 2.0  # MB
