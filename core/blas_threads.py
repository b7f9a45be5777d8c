"""The number of BLAS threads: two are slower than one on matrices of these sizes, and twice the processor time."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def pin_blas_threads() -> None:
    """Limit BLAS to one thread in this process, if numpy is not imported yet, and in its child processes.

    A number that is already set is kept.
    """
    for variable in VARIABLES:
        os.environ.setdefault(variable, "1")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread inside the block, where numpy was imported before slamgauge and no number is set."""
    if any(variable in os.environ for variable in VARIABLES):
        yield
        return
    # here: `python -m slamgauge` must not import libraries while the user's folder is the first place for modules
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        yield
