"""MATLAB files: matrices of real numbers are read in a child process; anything else is refused in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_array

from slamgauge.compare.datasets import mat_arrays
from slamgauge.compare.datasets.mat_arrays import read_mat
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow

FIELDS: dict[str, Any] = {
    "t": np.linspace(0.0, 1.0, 40)[:, None],
    "single": np.arange(6, dtype=np.float32).reshape(2, 3),
    "whole": np.array([[-5, 3], [2**31, 7]]),
    "valid": np.array([[True], [False]]),
    "small": np.uint8(7),
    "empty": np.zeros((0, 3)),
    "left": "not requested",
}
NAMES = [*FIELDS][:-1]


def test_matrices_are_returned_as_written_in_float64(tmp_path: Path):
    path = tmp_path / "m.mat"
    savemat(path, FIELDS)
    read = read_mat(path, [*NAMES, "missing"])
    assert [*read] == NAMES
    for name in NAMES:
        np.testing.assert_array_equal(read[name], np.atleast_2d(FIELDS[name]))
        assert read[name].dtype == np.float64


KINDS = ("text", 1j, csc_array(np.eye(2)), {"a": 1.0}, np.array([["a"]], object))
NOT_REAL = "field t is text, complex, sparse, a cell array or a struct; save a full"
NOT_FLAT = r"field t has shape \(2, 3, 4\); save a matrix of rows and columns"


@pytest.mark.parametrize(("field", "message"), [*((each, NOT_REAL) for each in KINDS), (np.zeros((2, 3, 4)), NOT_FLAT)])
def test_a_field_that_is_not_a_full_real_matrix_is_refused(tmp_path: Path, field: Any, message: str):
    savemat(tmp_path / "m.mat", {"t": field})
    with pytest.raises(UserError, match=message):
        read_mat(tmp_path / "m.mat", ["t"])


@pytest.mark.parametrize("is_compressed", [True, False])
def test_damaged_bytes_are_read_or_refused_in_one_line(tmp_path: Path, *, is_compressed: bool):
    """`benchmarks/fuzz.py` repeats this thousands of times."""
    path = tmp_path / "m.mat"
    savemat(path, FIELDS, do_compression=is_compressed)
    whole, rng, refused = np.frombuffer(path.read_bytes(), np.uint8), np.random.default_rng(0), 0
    for _ in range(8):
        damaged = whole.copy()
        at = rng.integers(128, len(whole), size=3)
        damaged[at] ^= rng.integers(1, 256, size=len(at), dtype=np.uint8)
        path.write_bytes(damaged.tobytes())
        try:
            read_mat(path, NAMES)
        except UserError as error:
            refused += 1
            assert str(error).startswith(f"{path}: ")
            assert "\n" not in str(error)
    assert refused > 2


@pytest.mark.skipif("sys.platform == 'win32'", reason="Windows has no memory limit")
def test_a_compressed_field_beyond_the_memory_limit_is_refused(tmp_path: Path):
    path = tmp_path / "m.mat"
    savemat(path, {"t": np.zeros((100, 1_500_000), np.uint8)}, do_compression=True)
    assert path.stat().st_size < 2_000_000
    with pytest.raises(UserError, match=rf"^{path}: reading it needs more than 1 GB of memory; give a part of it$"):
        read_mat(path, ["t"])


def test_a_child_that_takes_too_long_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    savemat(tmp_path / "m.mat", FIELDS)
    monkeypatch.setattr(mat_arrays, "TIME_LIMIT", 0.01)
    with pytest.raises(UserError, match=r"reading takes longer than 0.01 s; copy the file again$"):
        read_mat(tmp_path / "m.mat", NAMES)
