"""Print matrices of a MATLAB 5 file as npz; `mat_arrays` starts it as a child process.

python -P -m slamgauge.compare.datasets.mat_child PATH NAME ...
"""

from __future__ import annotations

import sys
import warnings
from typing import NoReturn

import numpy as np
from scipy.io import loadmat

from slamgauge.arrays import Float
from slamgauge.compare.datasets.mat_arrays import MEMORY_LIMIT, REFUSED


def main(path: str, *names: str) -> None:
    """Read, check and print; an exception ends the process with status 1, a refusal with `REFUSED`."""
    _limit_memory()
    warnings.simplefilter("error")  # scipy warns of a variable that it cannot read
    try:
        found = loadmat(path, variable_names=names)
        matrices = {name: _real(name, found[name]) for name in names if name in found}
    except MemoryError:
        _refuse(f"reading it needs more than {MEMORY_LIMIT / 1e9:g} GB of memory; give a part of it")
    np.savez(sys.stdout.buffer, allow_pickle=False, **matrices)


def _limit_memory() -> None:
    """Limit the address space of this process; Windows has no such limit."""
    if sys.platform != "win32":
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        limit = MEMORY_LIMIT if hard == resource.RLIM_INFINITY else min(MEMORY_LIMIT, hard)
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))


def _real(name: str, array: object) -> Float:
    """Return the array as float64 (rows, columns); refuse anything but a full matrix of real numbers."""
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
        _refuse(f"field {name} is text, complex, sparse, a cell array or a struct; save a full matrix of real numbers")
    if array.ndim != 2:
        _refuse(f"field {name} has shape {array.shape[:8]}; save a matrix of rows and columns")
    return array.astype(np.float64)


def _refuse(reason: str) -> NoReturn:
    """End the process with a reason of one line."""
    sys.stderr.write(reason)
    raise SystemExit(REFUSED)


if __name__ == "__main__":
    main(*sys.argv[1:])
