"""BLAS and LAPACK routines as kernels.

The routines are part of scipy. They are registered under fixed names, so that cached machine code finds them in every
process. With NUMBA_DISABLE_JIT=1 their numpy forms, at the end of this module, replace them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import llvmlite.binding as llvm
import numpy as np
from numba import types
from numba.extending import get_cython_function_address

from slamgauge.arrays import Float
from slamgauge.jit import NUMBA, inner


def _fortran(library: str, routine: str, arguments: int) -> Callable[..., None]:
    """Return a BLAS or LAPACK routine of scipy, callable from kernels with `arguments` pointers."""
    name = f"slamgauge_{routine}"
    llvm.add_symbol(name, get_cython_function_address(f"scipy.linalg.cython_{library}", routine))
    return cast("Callable[..., None]", types.ExternalFunction(name, types.void(*[types.voidptr] * arguments)))


_dsyrk = _fortran("blas", "dsyrk", 10)
_dsyr2k = _fortran("blas", "dsyr2k", 12)
_dtrsm = _fortran("blas", "dtrsm", 11)
_dgemv = _fortran("blas", "dgemv", 11)
_dpotrf = _fortran("lapack", "dpotrf", 5)

_LETTERS = np.frombuffer(b"LNRT", dtype=np.uint8)
_L, _N, _R, _T = range(4)
_REALS = np.array([0.0, 1.0, -1.0])
_ZERO, _ONE, _MINUS_ONE = range(3)
_UNIT_STRIDE = np.array([1], dtype=np.int32)

# Fortran reads row-major matrices as their transposes: the upper triangle here is the lower one ("L") there.


@inner
def cholesky(S: Float, rows: int) -> bool:
    """Factor S[:rows, :rows] = U'U in place, upper triangle only; return True if S is positive definite."""
    sizes = np.array([rows, S.shape[1], 0], dtype=np.int32)
    _dpotrf(_LETTERS[_L:].ctypes, sizes.ctypes, S.ctypes, sizes[1:].ctypes, sizes[2:].ctypes)
    return sizes[2] == 0


@inner
def solve_factor(S: Float, W: Float, rows: int, size: int) -> None:
    """W[:rows, :size] <- U'^-1 W; S contains the factor U from `cholesky`."""
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


@inner
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


@inner
def add_outer_pairs(P: Float, u: Float, a: Float, rows: int, size: int) -> None:
    """P <- P + u'a + a'u on the upper triangle of P[:size, :size], for u[:rows, :size] and a[:rows, :size]."""
    sizes = np.array([size, rows, P.shape[1], u.shape[1], a.shape[1]], dtype=np.int32)
    _dsyr2k(
        _LETTERS[_L:].ctypes,
        _LETTERS[_N:].ctypes,
        sizes.ctypes,
        sizes[1:].ctypes,
        _REALS[_ONE:].ctypes,
        u.ctypes,
        sizes[3:].ctypes,
        a.ctypes,
        sizes[4:].ctypes,
        _REALS[_ONE:].ctypes,
        P.ctypes,
        sizes[2:].ctypes,
    )


@inner
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


# --- the same in numpy, for kernels that are plain Python functions -------------------------------


def _cholesky(S: Float, rows: int) -> bool:
    try:
        upper = np.linalg.cholesky(np.triu(S[:rows, :rows]) + np.triu(S[:rows, :rows], 1).T).T
    except np.linalg.LinAlgError:
        return False
    S[:rows, :rows] = upper + np.tril(S[:rows, :rows], -1)
    return True


def _solve_factor(S: Float, W: Float, rows: int, size: int) -> None:
    W[:rows, :size] = np.linalg.solve(np.triu(S[:rows, :rows]).T, W[:rows, :size])


def _subtract_gram(P: Float, W: Float, rows: int, size: int) -> None:
    P[:size, :size] -= np.triu(W[:rows, :size].T @ W[:rows, :size])


def _add_outer_pairs(P: Float, u: Float, a: Float, rows: int, size: int) -> None:
    both = u[:rows, :size].T @ a[:rows, :size]
    P[:size, :size] += np.triu(both + both.T)


def _combine_rows(W: Float, weights: Float, out: Float, rows: int, size: int) -> None:
    out[:size] = W[:rows, :size].T @ weights[:rows]


if NUMBA.DISABLE_JIT:
    cholesky, solve_factor, combine_rows = _cholesky, _solve_factor, _combine_rows
    subtract_gram, add_outer_pairs = _subtract_gram, _add_outer_pairs
