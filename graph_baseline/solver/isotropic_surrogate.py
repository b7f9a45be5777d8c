"""A surrogate of a recording with isotropic noise: its cost, its minimum, and a proven lower bound of its cost.

Positions and headings are complex numbers: t_k and l_j are x + iy of poses and landmarks, z_k = exp(i heading_k). With
odometry (v_k, phi_k), observed positions p_m in the body frame, and standard deviations s_k, h_k and q_m, the cost is

    |A x|^2 / 2 = sum_k |t_{k+1} - t_k - v_k z_k|^2 / (2 s_k^2) + sum_k |z_{k+1} - exp(i phi_k) z_k|^2 / (2 h_k^2)
                + sum_m |l_j - t_k - p_m z_k|^2 / (2 q_m^2),          x = (z, t, l),  |z_k| = 1,  t_0 = 0.

It does not change if x is multiplied by a number of modulus 1, so that the heading of the first pose is chosen freely.

Lower bound. Let M = A* A, and D the diagonal matrix with 1 for headings and 0 for positions. For all real multipliers
a_k and b >= 0, every x with |z_k| = 1 has x* M x = sum_k a_k - K b + x* S x with S = M - diag(a, 0) + b D. If S has a
Cholesky factorisation, the cost is at least (sum_k a_k - K b) / 2. At a minimum, a_k = Re(conj(z_k) (M x)_k) are its
Lagrange multipliers, and S x = b D x. The smallest b for which S has no negative eigenvalue is 0 if the semidefinite
relaxation is tight; then the bound is the cost, and the minimum is the global one.

The factorisation has rounding errors: S = G G* + E. S + diag(e) has no negative eigenvalue if each e_i is at least the
sum of row i of |E| (Gershgorin). Therefore headings lose e_i from the bound, and the factorised matrix is S minus a
margin for positions that must exceed their e_i.

Sources: Rosen, Carlone, Bandeira and Leonard, "SE-Sync", IJRR 38(2-3), 2019; Fan, Wang, Rubenstein and Murphey,
"CPL-SLAM", IEEE T-RO 36(6), 2020 (complex numbers).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, csc_array, csr_array, diags_array, vstack
from scipy.sparse.linalg import SuperLU, splu

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.preparation import NEAREST, Problem
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.se2 import compose
from slamgauge.sensors import SENSORS, inverse

Complex = NDArray[np.complex128]
Sparse = Any  # sparse arrays of scipy, whose type stubs refuse complex slices

SMALLEST = 1e-4  # smallest variance, relative to the largest; headings are compared at the longest observed distance
MAX_STEPS = 100
CONVERGED = 1e-13  # expected decrease of the cost that ends the descent, relative to max(cost, 1)
NEAR = 1e-4  # the same for a start of the exact cost
GENTLE, STRONGER, STRONGEST = 1e-6, 10.0, 1e6  # damping relative to the diagonal of the Hessian
POWER_STEPS = 30  # steps of the inverse power method
FIRST_GAP, WIDER = 1e-9, 2.0  # first relative loss K b / 2 of the bound, and factor between successive b
ROUNDING = 0.5 * float(np.finfo(np.float64).eps)  # relative error of a sum of n complex products, divided by n + 2


@dataclass(frozen=True)
class Surrogate:
    """The matrix A of the cost |A x|^2 / 2, and the number K of poses; see the heading."""

    A: Sparse
    poses: int

    @cached_property
    def normal(self) -> Sparse:
        """(n, n) matrix M = A* A."""
        return csc_array(self.A.conj().T @ self.A)

    def cost(self, x: Complex) -> float:
        """Return |A x|^2 / 2."""
        return 0.5 * float(np.square(np.abs(self.A @ x)).sum())

    def gradient(self, x: Complex) -> Complex:
        """Return M x, with fewer rounding errors than M has."""
        return self.A.conj().T @ (self.A @ x)

    def on_headings(self, values: Float | float) -> Float:
        """Return a vector (n,) with values (K,) for headings and 0 for positions."""
        padded = np.zeros(self.A.shape[1])
        padded[: self.poses] = values
        return padded

    def multipliers(self, x: Complex) -> Float:
        """Return the multipliers a (K,) at x."""
        return (x.conj() * self.gradient(x)).real[: self.poses]


def surrogate_of(problem: Problem) -> Surrogate:
    """Return the surrogate of a problem whose sensor places landmarks.

    An observation gets the larger variance of its position, and a motion those of `motion_variances`.
    """
    count = problem.steps + 1
    points = inverse(problem.sensor, problem.observation)
    shifted, turned = motion_variances(problem.odometry_cov)
    seen = np.linalg.eigvalsh(_position_cov(problem))[:, 1]
    largest = max(shifted.max(initial=0.0), seen.max(initial=0.0))
    reach = np.square(points).sum(axis=1).max(initial=NEAREST**2)  # m^2
    shifted, seen = (np.maximum(each, SMALLEST * largest) for each in (shifted, seen))
    turned = np.maximum(turned, SMALLEST * max(turned.max(initial=0.0), largest / reach))
    z, t, landmark = np.arange(count), count + np.arange(count), 2 * count + problem.slot
    first, second = np.concatenate([z[:-1], problem.observation_step]), np.concatenate([t[1:], landmark])
    lever = np.concatenate([problem.odometry[:, :2], points]) @ [1.0, 1.0j]
    columns = 2 * count + len(problem.landmark_ids)
    places = _rows(np.concatenate([shifted, seen]), [(second, 1.0), (t[first], -1.0), (z[first], -lever)], columns)
    turns = _rows(turned, [(z[1:], 1.0), (z[:-1], -np.exp(1j * problem.odometry[:, 2]))], columns)
    A: Sparse = csc_array(vstack([places, turns]))
    return Surrogate(csr_array(A[:, np.arange(A.shape[1]) != count]), count)


def _rows(variances: Float, entries: Sequence[tuple[Int, Any]], columns: int) -> Sparse:
    """Return a row for each variance, divided by its root; `entries` are columns and complex values."""
    count = len(variances)
    row = np.tile(np.arange(count), len(entries))
    column = np.concatenate([each for each, _ in entries])
    value = np.concatenate([np.broadcast_to(each, count) / np.sqrt(variances) for _, each in entries])
    return csr_array((value.astype(np.complex128), (row, column)), shape=(count, columns))


def motion_variances(cov: Float) -> tuple[Float, Float]:
    """Return variances (N,) of translation [m^2] and heading [rad^2] that exceed covariances (N, 3, 3).

    For a covariance Q = B C B with B = diag(s, s, h), s^2 the larger variance of the translation, they are c s^2 and
    c h^2, where c is the largest eigenvalue of C: then Q <= c B^2.
    """
    moved, turned = np.linalg.eigvalsh(cov[:, :2, :2])[:, 1], cov[:, 2, 2]
    root = np.sqrt(np.maximum(np.column_stack([moved, moved, turned]), np.finfo(np.float64).tiny))
    factor = np.linalg.eigvalsh(cov / root[:, :, None] / root[:, None, :])[:, 2]
    factor = np.clip(factor, 1.0, 3.0, dtype=np.float64)  # C has a trace of at most 3
    return factor * moved, factor * turned


def _position_cov(problem: Problem) -> Float:
    """Return covariances (M, 2, 2) [m^2] of observed positions, along and across the ray if bearings are observed."""
    if not SENSORS[problem.sensor].has_bearing:
        return problem.observation_cov
    scale = np.column_stack([np.ones(len(problem.observation)), problem.observation[:, 0]])
    return scale[:, :, None] * problem.observation_cov * scale[:, None, :]


# --- minimum -------------------------------------------------------------------------------------


def minimum(surrogate: Surrogate, headings: Complex, converged: float = CONVERGED) -> Complex:
    """Return x (n,) of the minimum that Newton steps reach from headings (K,) of modulus 1, damped where needed.

    The steps end when the expected decrease of the cost, relative to max(cost, 1), is below `converged`.
    """
    x = with_positions(surrogate, headings)
    cost, factor = surrogate.cost(x), 0.0
    for _ in range(MAX_STEPS):
        hessian, gradient = derivatives(surrogate, x)
        diagonal = np.abs(hessian.diagonal())
        while True:
            found, tried, expected = np.inf, x, 0.0
            if (factors := cholesky(hessian + diags_array(factor * diagonal))) is not None:
                step = -factors.solve(gradient)
                tried, expected = moved(surrogate, x, step), -0.5 * float(gradient @ step)
                found = surrogate.cost(tried)
            if expected <= converged * max(cost, 1.0) and np.isfinite(found):
                return tried if found <= cost * (1.0 + CONVERGED) else x
            if found <= cost:
                break
            factor = max(STRONGER * factor, GENTLE)
            if factor > STRONGEST:
                return x
        x, cost, factor = tried, found, factor / STRONGER if factor > GENTLE else 0.0
    return x


def derivatives(surrogate: Surrogate, x: Complex) -> tuple[Sparse, Float]:
    """Return Hessian and gradient by the headings [rad] except the first, and by real and imaginary positions."""
    poses, slope = surrogate.poses, surrogate.gradient(x)
    turn: Sparse = diags_array(np.concatenate([1j * x[:poses], np.ones(len(x) - poses)]))
    S: Sparse = surrogate.normal - diags_array(surrogate.on_headings(surrogate.multipliers(x)))
    H: Sparse = csc_array(turn.conj() @ S @ turn)[1:, 1:]
    zz, zt, tt = H[: poses - 1, : poses - 1], H[: poses - 1, poses - 1 :], H[poses - 1 :, poses - 1 :]
    hessian: Sparse = block_array(
        [[zz.real, zt.real, -zt.imag], [zt.real.T, tt.real, -tt.imag], [-zt.imag.T, tt.imag, tt.real]], format="csc"
    )
    slope = turn.conj() @ slope
    return hessian, np.concatenate([slope[1:].real, slope[poses:].imag])


def moved(surrogate: Surrogate, x: Complex, step: Float) -> Complex:
    """Return x (n,) after a step in the unknowns of `derivatives`; moduli of headings remain 1."""
    poses, rest = surrogate.poses, len(x) - surrogate.poses
    turned = x[1:poses] * np.exp(1j * step[: poses - 1])
    return np.concatenate([x[:1], turned, x[poses:] + step[poses - 1 : -rest] + 1j * step[-rest:]])


def with_positions(surrogate: Surrogate, headings: Complex) -> Complex:
    """Return x (n,) with headings (K,) and the positions of the smallest cost."""
    poses = surrogate.poses
    x = np.concatenate([headings, np.zeros(surrogate.A.shape[1] - poses, np.complex128)])
    x[poses:] = -_required(surrogate.normal[poses:, poses:]).solve(surrogate.gradient(x)[poses:])
    return x


def spectral_headings(surrogate: Surrogate) -> Complex:
    """Return headings (K,) of modulus 1, from the smallest cost with sum |z_k|^2 = K in place of |z_k| = 1."""
    poses = surrogate.poses
    shift = 1e-9 * surrogate.normal.diagonal()[:poses].real.max()
    factors = _required(surrogate.normal + diags_array(surrogate.on_headings(shift)))
    headings = np.exp(2j * np.pi * np.random.default_rng(0).uniform(size=poses))
    for _ in range(POWER_STEPS):
        x = factors.solve(np.concatenate([headings, np.zeros(surrogate.A.shape[1] - poses)]))
        headings = x[:poses] / np.linalg.norm(x[:poses])
    return np.exp(1j * np.angle(headings))


def path_and_map(problem: Problem, x: Complex) -> tuple[Float, Float]:
    """Return poses (N+1, 3), the first at the prior mean, and landmarks (L, 2), ids increasing, of x (n,)."""
    count = problem.steps + 1
    turned: Complex = x / x[0]
    places: Complex = np.concatenate([[0.0], turned[count:]])
    local = np.column_stack([places.real, places.imag, np.angle(np.concatenate([turned[:count], places[count:]]))])
    found = compose(problem.prior_mean, local)
    return found[:count], found[count:, :2]


def surrogate_start(problem: Problem) -> tuple[Float, Float]:
    """Return poses (N+1, 3) and landmarks (L, 2) of the surrogate's minimum, as a start for the exact cost."""
    surrogate = surrogate_of(problem)
    return path_and_map(problem, minimum(surrogate, spectral_headings(surrogate), NEAR))


# --- lower bound ---------------------------------------------------------------------------------


def lower_bound(surrogate: Surrogate, x: Complex) -> float:
    """Return a lower bound of the surrogate's cost from the multipliers at x (n,), also valid with rounding errors."""
    a, poses, size = surrogate.multipliers(x), surrogate.poses, abs(surrogate.A)
    rounding = ROUNDING * (2.0 + np.diff(csc_array(size).indptr)) * (size.T @ (size @ np.ones(len(x))))
    margin = 2.0 * rounding[poses:]
    b = FIRST_GAP * max(float(a.sum()), 2.0) / poses
    while b * poses < a.sum():
        S = csc_array(surrogate.normal + diags_array(np.concatenate([b - a, -margin])))
        error = rounding + _factorisation_error(S)
        if not np.isfinite(error).all():
            b *= WIDER
        elif (error[poses:] > margin).any():
            margin = 2.0 * error[poses:]
        else:
            return max(0.5 * float(a.sum() - poses * b - error[:poses].sum()), 0.0)
    return 0.0


def _factorisation_error(S: Sparse) -> Float:
    """Return the row sums (n,) of |S - G G*| for a Cholesky factor G, infinite if S has none."""
    factors = cholesky(S)
    if factors is None:
        return np.full(S.shape[0], np.inf)
    order = np.argsort(factors.perm_c)
    G = csc_array(factors.L) @ diags_array(np.sqrt(factors.U.diagonal().real))
    size = abs(G)
    rounding = ROUNDING * (2.0 + np.diff(csr_array(G).indptr)) * (size @ (size.T @ np.ones(len(order))))
    E = S[order][:, order] - G @ G.conj().T
    error = np.empty(len(order))
    error[order] = abs(E).sum(axis=1) + rounding
    return error


def cholesky(S: Sparse) -> SuperLU | None:
    """Return a factorisation P S P' = L U with positive diagonal of U, or None if a pivot is not positive."""
    try:
        factors = splu(csc_array(S), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:  # an exact zero
        return None
    positive = (factors.U.diagonal().real > 0.0).all()
    return factors if positive and np.array_equal(factors.perm_r, factors.perm_c) else None


def _required(S: Sparse) -> SuperLU:
    """Return the Cholesky factorisation of S.

    Raises:
        UndeterminedError: rounding errors make a pivot negative.
    """
    factors = cholesky(S)
    if factors is None:
        raise UndeterminedError("surrogate: its variances differ too much for double precision; raise the smallest")
    return factors
