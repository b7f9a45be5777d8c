"""Where the hindsight optimum spends its time, against map size: one table in seconds.

    python benchmarks/optimum_times.py [--landmarks 20,100,300,1000] [--marginals 300]

Graph building, GTSAM's optimisation, one exact Newton step with every covariance from the Schur
complement, and, up to `--marginals` landmarks, GTSAM's own `Marginals` for every pose and landmark.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
from collections.abc import Callable
from time import perf_counter
from typing import ParamSpec, TypeVar

import gtsam
from gtsam.symbol_shorthand import L, X

from slamgauge import simulate
from slamgauge.compare.bench.bench import workload
from slamgauge.graph_baseline.factors import LENT_SLIP, build_graph, first_sights, make_values
from slamgauge.graph_baseline.hindsight import finish, minimise
from slamgauge.graph_baseline.smoother import solve_at

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
    titles = ("landmarks", "build", "optimise", "build/opt.", "finish", "one solve", "Marginals")
    print(" ".join(f"{title:>10}" for title in titles))
    for size in map(int, options.landmarks.split(",")):
        _, recording = simulate(workload(size), 0)
        ids = first_sights(recording)[0]
        build, graph = timed(build_graph, recording, LENT_SLIP)
        optimise, (poses, landmarks) = timed(minimise, recording, graph)
        finishing, (poses, landmarks, _) = timed(finish, recording, ids, poses, landmarks)
        once, _ = timed(solve_at, recording, ids, poses, landmarks)
        marginal_time = "-"
        if size <= options.marginals:
            exact, values = build_graph(recording), make_values(poses, ids, landmarks)
            seconds, _ = timed(every_marginal, exact, values, len(poses), ids.tolist())
            marginal_time = f"{seconds:.2f}"
        cells = (f"{build:.3f}", f"{optimise:.2f}", f"{build / optimise:.1%}", f"{finishing:.2f}", f"{once:.3f}")
        print(" ".join(f"{cell:>10}" for cell in (size, *cells, marginal_time)), flush=True)


def every_marginal(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, poses: int, ids: list[int]) -> None:
    marginals = gtsam.Marginals(graph, values)
    for key in [X(k) for k in range(poses)] + [L(name) for name in ids]:
        marginals.marginalCovariance(key)


if __name__ == "__main__":
    main()
