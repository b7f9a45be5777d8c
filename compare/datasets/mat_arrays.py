"""Matrices of real numbers from a MATLAB 5 file.

`scipy.io.loadmat` is compiled code that can crash on a damaged file. It therefore runs in a child process
(`mat_child.py`) with a memory limit and a time limit.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Collection
from io import BytesIO
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.storage.files import explained
from slamgauge.errors import UserError

BEGINNING = b"MATLAB 5.0 MAT-file"
REFUSED = 3  # exit status of the child: the file is whole, and its last line on stderr says why it is refused
MEMORY_LIMIT = (
    1_000_000_000  # bytes of the child, Python and scipy included; this process then needs twice as much at most
)
TIME_LIMIT = 120.0  # [s], start of Python and scipy included


def read_mat(path: Path, names: Collection[str]) -> dict[str, Float]:
    """Return the matrices of these names that the file contains, float64 (rows, columns).

    Raises:
        UserError: The file is missing, damaged or too large, or a matrix is not full and real.
    """
    with explained(path, "read"), path.open("rb") as file:
        beginning = file.read(len(BEGINNING))
    if beginning != BEGINNING:
        raise UserError(f"{path}: not a MATLAB 5 file; save it with -v7")
    command = [sys.executable, "-P", "-m", "slamgauge.compare.datasets.mat_child", str(path), *names]
    one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # each thread reserves memory
    try:
        child = subprocess.run(command, capture_output=True, timeout=TIME_LIMIT, env=one_thread, check=False)
    except subprocess.TimeoutExpired:
        raise UserError(f"{path}: reading takes longer than {TIME_LIMIT:g} s; copy the file again") from None
    if child.returncode == REFUSED:
        raise UserError(f"{path}: {child.stderr.decode().splitlines()[-1]}")
    if child.returncode != 0:
        raise UserError(f"{path}: damaged or cut short; copy the file again")
    with np.load(BytesIO(child.stdout), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in names if name in arrays}
