"""Where the hindsight optimum spends its time, against map size: one table in seconds.

    python benchmarks/optimum_times.py [--landmarks 20,100,300,1000] [--marginals 300]

Graph building, GTSAM's optimisation, one exact Newton step with every covariance from the Schur
complement, and, up to `--marginals` landmarks, GTSAM's own `Marginals` for every pose and landmark. The robot cannot
slip sideways, so the system is constrained; where GTSAM finds it indeterminate, its `Marginals` has no figure and the
row says so.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
from collections.abc import Callable
from time import perf_counter
from typing import ParamSpec, TypeVar

import gtsam

from slamgauge import Recording, simulate
from slamgauge.arrays import Float, Int
from slamgauge.compare.bench.step_times import workload
from slamgauge.graph_baseline.gtsam_graph import REGULARISING_NOISE, build_graph, make_values
from slamgauge.graph_baseline.problem.preparation import first_sights
from slamgauge.graph_baseline.solver.levenberg_marquardt import Minimum, approach, settle
from slamgauge.graph_baseline.solver.multistart import searched
from slamgauge.graph_baseline.solver.smoother import solve_at
from slamgauge.se2 import chain

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def timed(work: Callable[Arguments, Result], *args: Arguments.args, **kwargs: Arguments.kwargs) -> tuple[float, Result]:
    start = perf_counter()
    result = work(*args, **kwargs)
    return perf_counter() - start, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--landmarks", default="20,100,300,1000")
    parser.add_argument("--marginals", type=int, default=300)
    options = parser.parse_args()
    titles = ("landmarks", "build", "optimise", "build/opt.", "finish", "one solve")
    print(" ".join(f"{title:>10}" for title in titles), f"{'Marginals':>13}")
    for size in map(int, options.landmarks.split(",")):
        _, recording = simulate(workload(size), 0)
        ids = first_sights(recording)[0]
        build, _ = timed(build_graph, recording, REGULARISING_NOISE)
        path = chain(recording.prior_mean, recording.odometry)
        optimise, (poses, landmarks) = timed(searched, recording, path)
        finishing, (poses, landmarks, _, _) = timed(finished, recording, ids, poses, landmarks)
        once, _ = timed(solve_at, recording, ids, poses, landmarks)
        marginals = "-"
        if size <= options.marginals:
            exact, values = build_graph(recording), make_values(poses, ids, landmarks)
            marginals = marginals_time(exact, values)
        cells = (f"{build:.3f}", f"{optimise:.2f}", f"{build / optimise:.1%}", f"{finishing:.2f}", f"{once:.3f}")
        print(" ".join(f"{cell:>10}" for cell in (size, *cells)), f"{marginals:>13}", flush=True)


def finished(recording: Recording, ids: Int, poses: Float, landmarks: Float) -> Minimum:
    """The exact minimum that a start leads to."""
    return settle(recording, ids, approach(recording, ids, poses, landmarks))


def marginals_time(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> str:
    """Seconds that GTSAM's `Marginals` takes for every key, or that it finds the system indeterminate."""
    try:
        return f"{timed(every_marginal, graph, values)[0]:.2f}"
    except RuntimeError as error:  # IndeterminateLinearSystemException has no type of its own in Python
        if "Indeterminate linear system" not in str(error):
            raise
        return "indeterminate"


def every_marginal(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
    marginals = gtsam.Marginals(graph, values)
    keys = values.keys()
    for key in keys:
        marginals.marginalCovariance(key)


if __name__ == "__main__":
    main()
