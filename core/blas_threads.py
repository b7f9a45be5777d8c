"""The number of BLAS threads: two are slower than one on matrices of these sizes, and twice the processor time."""

import os

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def pin_blas_threads() -> None:
    """Limit BLAS to one thread in this process, if numpy is not imported yet, and in its child processes.

    A number that is already set is kept.
    """
    for variable in VARIABLES:
        os.environ.setdefault(variable, "1")
