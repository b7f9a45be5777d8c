"""Matrices of real numbers from a MATLAB 5 file.

`scipy.io.loadmat` is compiled code that can crash on a damaged file. It therefore runs in a child process with a memory
limit and a time limit: python -P -m slamgauge.compare.datasets.mat_arrays PATH NAME ...
"""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Collection
from io import BytesIO
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.regular_files import require_regular
from slamgauge.errors import UserError

BEGINNING = b"MATLAB 5.0 MAT-file"
REFUSED = 3  # exit status of the child: the file is whole, and its last line on stderr says why it is refused
MEMORY_LIMIT = 1_000_000_000  # bytes of the child with Python and scipy; this process then needs at most twice that
TIME_LIMIT = 120.0  # [s], start of Python and scipy included


def read_mat(path: Path, names: Collection[str]) -> dict[str, Float]:
    """Return the matrices of these names that the file contains, float64 (rows, columns).

    Raises:
        UserError: The file is missing, damaged or too large, or a matrix is not full and real.
    """
    with explained(path, "read"):
        require_regular(path)
        with path.open("rb") as file:
            beginning = file.read(len(BEGINNING))
    if beginning != BEGINNING:
        raise UserError(f"{path}: not a MATLAB 5 file; save it with -v7")
    command = [sys.executable, "-P", "-m", __name__, str(path), *names]
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


def print_matrices(path: str, *names: str) -> None:
    """Print the matrices as npz; an exception ends the process with status 1, a refusal with `REFUSED`."""
    from scipy.io import loadmat

    if sys.platform != "win32":  # Windows has no limit of the address space
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        limit = MEMORY_LIMIT if hard == resource.RLIM_INFINITY else min(MEMORY_LIMIT, hard)
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    warnings.simplefilter("error")  # scipy warns of a variable that it cannot read
    try:
        found = loadmat(path, variable_names=names)
        matrices = {name: _real(name, found[name]) for name in names if name in found}
    except (MemoryError, UserError) as error:
        too_large = f"reading it needs more than {MEMORY_LIMIT / 1e9:g} GB of memory; give a part of it"
        sys.stderr.write(str(error) if isinstance(error, UserError) else too_large)
        sys.exit(REFUSED)
    np.savez(sys.stdout.buffer, allow_pickle=False, **matrices)


def _real(name: str, array: object) -> Float:
    """Return the array as float64 (rows, columns); refuse anything but a full matrix of real numbers."""
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
        kinds = "text, complex, sparse, a cell array or a struct"
        raise UserError(f"field {name} is {kinds}; save a full matrix of real numbers")
    if array.ndim != 2:
        raise UserError(f"field {name} has shape {array.shape[:8]}; save a matrix of rows and columns")
    return array.astype(np.float64)


if __name__ == "__main__":
    print_matrices(*sys.argv[1:])
