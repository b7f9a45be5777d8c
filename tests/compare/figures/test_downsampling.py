from __future__ import annotations

import numpy as np

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
