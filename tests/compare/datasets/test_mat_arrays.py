"""MATLAB files: read as scipy reads them, and refused in one line whatever is done to their bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from slamgauge.compare.datasets.mat_arrays import read_mat
from slamgauge.errors import UserError

FIELDS: dict[str, Any] = {
    "t": np.linspace(0.0, 1.0, 40)[:, None],
    "single": np.arange(6, dtype=np.float32).reshape(2, 3),
    "whole": np.array([[-5, 3], [2**31, 7]]),
    "valid": np.array([[True], [False]]),
    "small": np.uint8(7),
    "empty": np.zeros((0, 3)),
    "left": "not asked for",
}
NAMES = [*FIELDS][:-1]


@pytest.mark.parametrize("is_compressed", [True, False])
def test_matrices_are_those_that_scipy_reads(tmp_path: Path, *, is_compressed: bool):
    path = tmp_path / "m.mat"
    savemat(path, FIELDS, do_compression=is_compressed)
    read, expected = read_mat(path, NAMES), loadmat(path)
    assert [*read] == NAMES
    for name in NAMES:
        np.testing.assert_array_equal(read[name], expected[name])
        assert read[name].dtype == np.float64


@pytest.mark.parametrize("is_compressed", [True, False])
def test_damaged_bytes_are_read_as_they_are_or_refused_in_one_line(tmp_path: Path, *, is_compressed: bool):
    """800 files with bytes that are others: `loadmat` ended the interpreter at some such. zlib's sums find all."""
    path = tmp_path / "m.mat"
    savemat(path, FIELDS, do_compression=is_compressed)
    whole, rng, refused = np.frombuffer(path.read_bytes(), np.uint8), np.random.default_rng(0), 0
    for _ in range(800):
        damaged = whole.copy()
        at = rng.integers(128, len(whole), size=rng.integers(1, 4))
        damaged[at] ^= rng.integers(1, 256, size=len(at), dtype=np.uint8)
        end = rng.integers(128, len(whole)) if rng.random() < 0.2 else len(whole)
        path.write_bytes(damaged[:end].tobytes())
        try:
            read = read_mat(path, NAMES)
        except UserError as error:
            refused += 1
            assert str(error).startswith(f"{path}: ")
            assert "\n" not in str(error)
        else:
            for name in read if is_compressed else ():
                np.testing.assert_array_equal(read[name], FIELDS[name])
    assert refused > 150


def test_a_stream_that_says_to_hold_more_than_there_is_memory_for_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "m.mat"
    savemat(path, {"t": np.zeros((1000, 1000))}, do_compression=True)
    assert path.stat().st_size < 10_000
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 1e7)
    with pytest.raises(UserError, match=rf"^{path}: reading it needs 0.0 GB of memory, and 0.0 GB are free; [^\n]+$"):
        read_mat(path, ["t"])


def test_a_matrix_that_is_there_twice_is_refused(tmp_path: Path):
    path = tmp_path / "m.mat"
    savemat(path, {"t": np.eye(2)})
    whole = path.read_bytes()
    path.write_bytes(whole + whole[128:])
    with pytest.raises(UserError, match="field t stands in it twice; save it again"):
        read_mat(path, ["t"])


@pytest.mark.parametrize("at", range(124, 128))
def test_a_header_that_ends_otherwise_is_refused(tmp_path: Path, at: int):
    """The version, and how bytes are ordered."""
    path = tmp_path / "m.mat"
    savemat(path, {"t": np.eye(2)})
    whole = bytearray(path.read_bytes())
    whole[at] ^= 0x3D
    path.write_bytes(whole)
    with pytest.raises(UserError, match=rf"^{path}: damaged or cut short; copy the file again$"):
        read_mat(path, ["t"])
