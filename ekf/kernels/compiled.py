"""Compilation of the filter kernels, and the BLAS and LAPACK routines that they call.

Kernels are compiled by numba on first use and kept on disk for later processes. The machine code of a kernel includes
that of the kernels it calls, but numba compares its age with its own source file alone: an edited kernel would live on
in its callers. Machine code older than any source of this folder, which holds all kernels, is therefore dropped. BLAS
is the one that scipy brings; its routines are registered under names of our own, so that cached machine code finds them
again in another process.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

import llvmlite.binding as llvm
import numpy as np
from numba import njit, typeof, types
from numba.core.dispatcher import Dispatcher
from numba.core.types import ExternalFunction
from numba.extending import get_cython_function_address

from slamgauge.arrays import Float

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def drop_outdated(package: Path) -> None:
    """Remove numba's indices in the package's cache that are older than its newest source."""
    newest = max((source.stat().st_mtime for source in package.rglob("*.py")), default=0.0)
    for index in package.rglob("__pycache__/*.nbi"):
        try:
            if index.stat().st_mtime < newest:
                index.unlink()
        except OSError:  # another process was first, or the folder is not ours to write to
            continue


drop_outdated(Path(__file__).parent)


def kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile `function` on first call; machine code is cached on disk where that is possible."""
    try:
        return njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # no folder that numba may write to
        return njit(error_model="numpy")(function)


def direct(function: Callable[Arguments, Result], *arguments: object) -> Callable[Arguments, Result]:
    """The machine code of a kernel for arguments of these types, compiled if it is not yet.

    A call then spares numba's look at every argument's type, a microsecond where there are a dozen arrays: they must be
    of the same types each time. What is no kernel is returned as it is.
    """
    if not isinstance(function, Dispatcher):
        return function
    return function.compile(tuple(map(typeof, arguments)))


def _fortran(library: str, routine: str, arguments: int) -> Callable[..., None]:
    """A BLAS or LAPACK routine of scipy's, callable from kernels with `arguments` pointers."""
    name = f"slamgauge_{routine}"
    llvm.add_symbol(name, get_cython_function_address(f"scipy.linalg.cython_{library}", routine))
    return cast("Callable[..., None]", ExternalFunction(name, types.void(*[types.voidptr] * arguments)))


_dsyrk = _fortran("blas", "dsyrk", 10)
_dsyr2 = _fortran("blas", "dsyr2", 9)
_dtrsm = _fortran("blas", "dtrsm", 11)
_dgemv = _fortran("blas", "dgemv", 11)
_dgemm = _fortran("blas", "dgemm", 13)
_dpotrf = _fortran("lapack", "dpotrf", 5)

_LETTERS = np.frombuffer(b"LNRT", dtype=np.uint8)
_L, _N, _R, _T = range(4)
_REALS = np.array([0.0, 1.0, -1.0])
_ZERO, _ONE, _MINUS_ONE = range(3)
_UNIT_STRIDE = np.array([1], dtype=np.int32)

# Fortran reads our row-major matrices transposed: what is the upper triangle here is "L" there.


@kernel
def cholesky(S: Float, rows: int) -> bool:
    """Factor S[:rows, :rows] = U'U in place, upper triangle only; True if it is positive definite."""
    sizes = np.array([rows, S.shape[1], 0], dtype=np.int32)
    _dpotrf(_LETTERS[_L:].ctypes, sizes.ctypes, S.ctypes, sizes[1:].ctypes, sizes[2:].ctypes)
    return sizes[2] == 0


@kernel
def solve_factor(S: Float, W: Float, rows: int, size: int) -> None:
    """W[:rows, :size] <- U'^-1 W for the factor U that `cholesky` left in S."""
    sizes = np.array([size, rows, S.shape[1], W.shape[1]], dtype=np.int32)
    _dtrsm(
        _LETTERS[_R:].ctypes,
        _LETTERS[_L:].ctypes,
        _LETTERS[_T:].ctypes,
        _LETTERS[_N:].ctypes,
        sizes.ctypes,
        sizes[1:].ctypes,
        _REALS[_ONE:].ctypes,
        S.ctypes,
        sizes[2:].ctypes,
        W.ctypes,
        sizes[3:].ctypes,
    )


@kernel
def subtract_gram(P: Float, W: Float, rows: int, size: int) -> None:
    """P <- P - W'W on the upper triangle of P[:size, :size], for W[:rows, :size]."""
    sizes = np.array([size, rows, P.shape[1], W.shape[1]], dtype=np.int32)
    _dsyrk(
        _LETTERS[_L:].ctypes,
        _LETTERS[_N:].ctypes,
        sizes.ctypes,
        sizes[1:].ctypes,
        _REALS[_MINUS_ONE:].ctypes,
        W.ctypes,
        sizes[3:].ctypes,
        _REALS[_ONE:].ctypes,
        P.ctypes,
        sizes[2:].ctypes,
    )


@kernel
def add_outer_pair(P: Float, u: Float, v: Float, size: int) -> None:
    """P <- P + u v' + v u' on the upper triangle of P[:size, :size]."""
    sizes = np.array([size, P.shape[1]], dtype=np.int32)
    _dsyr2(
        _LETTERS[_L:].ctypes,
        sizes.ctypes,
        _REALS[_ONE:].ctypes,
        u.ctypes,
        _UNIT_STRIDE.ctypes,
        v.ctypes,
        _UNIT_STRIDE.ctypes,
        P.ctypes,
        sizes[1:].ctypes,
    )


@kernel
def combine_rows(W: Float, weights: Float, out: Float, rows: int, size: int) -> None:
    """out[:size] = W' weights for W[:rows, :size]."""
    sizes = np.array([size, rows, W.shape[1]], dtype=np.int32)
    _dgemv(
        _LETTERS[_N:].ctypes,
        sizes.ctypes,
        sizes[1:].ctypes,
        _REALS[_ONE:].ctypes,
        W.ctypes,
        sizes[2:].ctypes,
        weights.ctypes,
        _UNIT_STRIDE.ctypes,
        _REALS[_ZERO:].ctypes,
        out.ctypes,
        _UNIT_STRIDE.ctypes,
    )


@kernel
def subtract_product(out: Float, W: Float, T: Float, rows: int, height: int, width: int) -> None:
    """out[:height, :width] <- out - W'T for W[:rows, :height] and T[:rows, :width]."""
    sizes = np.array([width, height, rows, T.shape[1], W.shape[1], out.shape[1]], dtype=np.int32)
    _dgemm(
        _LETTERS[_N:].ctypes,
        _LETTERS[_T:].ctypes,
        sizes.ctypes,
        sizes[1:].ctypes,
        sizes[2:].ctypes,
        _REALS[_MINUS_ONE:].ctypes,
        T.ctypes,
        sizes[3:].ctypes,
        W.ctypes,
        sizes[4:].ctypes,
        _REALS[_ONE:].ctypes,
        out.ctypes,
        sizes[5:].ctypes,
    )
