"""Compiled kernels of the graphs: the message, one compilation per kernel, and the accuracy of LAPACK."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from slamgauge import batch, causal, load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem import residuals
from slamgauge.graph_baseline.solver import chord_kernels, matrices_3x3, pose_elimination, recursions, scan_reduction
from slamgauge.graph_baseline.solver.matrices_3x3 import factorise, invert
from slamgauge.graph_baseline.solver.warm_up import compile_graphs_once
from tests.reference.installed_copy import first_and_later_use
from tests.reference.random_recordings import bearing_only, recording_of


def specialisations() -> dict[str, int]:
    """Return for each kernel the number of argument types for which it has been compiled."""
    return {
        f"{module.__name__}.{name}": len(each.signatures)
        for module in (chord_kernels, pose_elimination, residuals, recursions, scan_reduction, matrices_3x3)
        for name, each in vars(module).items()
        if isinstance(each, Dispatcher)
    }


def test_first_use_is_announced_and_later_ones_load_from_disk(tmp_path: Path) -> None:
    program = (
        "from slamgauge.graph_baseline.solver.warm_up import compile_graphs_once as once; once();"
        "from slamgauge.graph_baseline.solver import pose_elimination;"
        "print(len(pose_elimination.eliminate_poses.stats.cache_hits))"
    )
    first, second = first_and_later_use(tmp_path, program, "pose_elimination.eliminate_poses")
    assert first.stderr == "slamgauge: compiling ~52 graph kernels on first use ...\n"
    assert (first.stdout, second.stdout, second.stderr) == ("0\n", "1\n", "")


def test_no_recording_needs_another_compilation_after_the_first_use() -> None:
    compile_graphs_once()
    before = specialisations()
    for sensor in ("position", "range-bearing"):
        recording = recording_of(sensor, 1)
        causal(recording)
        batch(recording)
    causal(recording_of("bearing", 1))
    scenario = load_scenario("q1-short-dense", ["trajectory.duration=2"])
    constant_noise = simulate(scenario, 0)[1]  # one covariance is stored for all rows
    for each in (constant_noise, bearing_only(constant_noise)):
        causal(each)
        batch(each)
    assert specialisations() == before


def exact_inverse(A: Float) -> Float:
    """Return the inverse of A, computed with fractions."""
    rows = [[Fraction(x) for x in row] + [Fraction(int(i == j)) for j in range(3)] for i, row in enumerate(A.tolist())]
    for i in range(3):
        pivot = max(range(i, 3), key=lambda n: abs(rows[n][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for n in {0, 1, 2} - {i}:
            rows[n] = [x - rows[n][i] * y for x, y in zip(rows[n], rows[i], strict=True)]
    return np.array([[float(x) for x in row[3:]] for row in rows])


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_inverse_is_as_accurate_as_lapacks(rank: int) -> None:
    """A = I + P N with singular P, and N up to 1e16 times larger; errors are compared with the largest of LAPACK."""
    rng, ours, theirs = np.random.default_rng(rank), 0.0, 0.0
    for _ in range(300):
        P = rng.normal(size=(3, rank)) * 10.0 ** rng.uniform(-4, 4, rank)
        N = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-4, 4, 3)
        A, found = np.eye(3) + (P @ P.T) @ (N @ N.T), np.empty((3, 3))
        if np.linalg.cond(A) > 1e14:  # all digits are rounding
            continue
        exact = exact_inverse(A)
        invert(A.copy(), found)
        size = np.abs(exact).max() * np.linalg.cond(A) * np.finfo(np.float64).eps
        ours = max(ours, float(np.abs(found - exact).max() / size))
        theirs = max(theirs, float(np.abs(np.linalg.inv(A) - exact).max() / size))
    assert ours < 2.0 * theirs


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_singular_and_infinite_matrices_are_refused(bad: float) -> None:
    A = np.diag([1.0, bad, 2.0])
    with pytest.raises(np.linalg.LinAlgError, match="inverse"):
        invert(A.copy(), np.empty((3, 3)))
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        factorise(A)


def test_the_cholesky_factor() -> None:
    root = np.tril(np.random.default_rng(1).normal(size=(3, 3))) + 2.0 * np.eye(3)
    A = root @ root.T
    factorise(A)
    np.testing.assert_allclose(np.tril(A), root, atol=1e-14)
