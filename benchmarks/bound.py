"""The Cramer-Rao bound of scenarios, two ways, and how near to it the optima and the best filter come; one table.

    python benchmarks/bound.py [--scenarios q1-short-dense,q1-long-dense] [--runs 100] [--seed 100] [--jobs 2]

*bound* and *hindsight* are those of studies, means over runs of each run's own; *expected* is the inverse of the mean
information (Tichavsky, Muravchik & Nehorai 1998), taken in the frame of the true start, where all runs take the same
path; both as a mean over steps of the root of the mean square [m]. Then errors over the bound of their kind, with 95 %
intervals.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from slamgauge import Recording, Truth, load_scenario, run_study, simulate
from slamgauge.arrays import Float
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.studies.executors import local_processes
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.graph_baseline.bound import causal_covariances, model_at_truth
from slamgauge.graph_baseline.problem.linearisation import LinearModel
from slamgauge.graph_baseline.solver.smoother import solve
from slamgauge.se2 import between, rotation

NAMES = ("riekf", "causal", "batch")
MOST_POOLED = 100  # runs whose information is averaged


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenarios", default="q1-short-dense,q1-long-dense,q1-long-sparse,q4-ring,ukfm-slam2d")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    heads = (f"{'bound':>9}{'expected':>10}{'hindsight':>11}{'expected':>10}", *(f"{name:>16}" for name in NAMES))
    print(f"{'scenario':16}" + "".join(heads))
    for name in options.scenarios.split(","):
        scenario = load_scenario(name, ["start=sampled"])
        with TemporaryDirectory() as folder, local_processes(options.jobs) as executor:
            chosen = (*NAMES, "bound")
            summary = run_study(scenario, options.runs, options.seed, chosen, Path(folder), executor)
        bounds = summary.to_json()["bound"]
        runs = min(options.runs, MOST_POOLED)
        causal, hindsight = expected_bounds(informed(scenario), [run_seed(options.seed, run) for run in range(runs)])
        line = f"{name:16}{bounds['causal_position_rmse_m']:9.5f}{causal:10.5f}"
        line += f"{bounds['hindsight_position_rmse_m']:11.5f}{hindsight:10.5f}"
        for each in NAMES:
            ratio = summary.estimators[each].ratio_to_bound
            assert ratio is not None
            half = np.nan if ratio.high is None else ratio.high - ratio.mean
            line += f"{ratio.mean:9.3f} ± {half:.3f}"
        print(line, flush=True)


def expected_bounds(scenario: Scenario, seeds: list[int]) -> tuple[float, float]:
    """Causal and hindsight position bound [m] by the inverse of the mean information."""
    models = [model_at_start(*simulate(scenario, seed)) for seed in seeds]
    model, landmarks = pooled(models)
    return position_rmse(causal_covariances(model, landmarks)), position_rmse(solve(model, landmarks).pose_covs)


def position_rmse(covs: Float) -> float:
    return float(np.sqrt(np.trace(covs[:, :2, :2], axis1=1, axis2=2)).mean())


def model_at_start(truth: Truth, recording: Recording) -> LinearModel:
    """The linear model at the truth in the frame of its start; its slots are numbers of landmarks in the scenario."""
    assert truth.poses is not None
    assert truth.landmarks is not None
    assert truth.landmark_ids is not None
    assert truth.association is not None
    start, turn = truth.poses[0], np.eye(3)
    turn[:2, :2] = rotation(start[2])
    here = Truth(
        poses=between(np.tile(start, (len(truth.poses), 1)), truth.poses),
        landmark_ids=truth.landmark_ids,
        landmarks=(truth.landmarks - start[:2]) @ turn[:2, :2],
        association=truth.association,
    )
    model, landmarks = model_at_truth(here, recording)
    ids, first = np.unique(truth.association, return_index=True)
    if landmarks < len(ids):
        raise SystemExit("a landmark is seen once: take another scenario")
    return model._replace(start_cov=turn.T @ model.start_cov @ turn, slot=ids[np.argsort(first)][model.slot])


def pooled(models: list[LinearModel]) -> tuple[LinearModel, int]:
    """The model whose information is the mean of theirs, and its number of landmarks, numbered by first sight."""
    one = models[0]
    for each in models:
        for ours, theirs in ((each.start_cov, one.start_cov), (each.F, one.F), (each.W, one.W)):
            if not np.allclose(ours, theirs, rtol=1e-9, atol=1e-12):
                raise SystemExit("paths or their noise differ from run to run: take another scenario")
    step = np.concatenate([each.step for each in models])
    order = np.argsort(step, kind="stable")
    slot = np.concatenate([each.slot for each in models])[order]
    share = 1.0 / np.sqrt(len(models))
    Hx, Hm, r = (share * np.concatenate([getattr(each, key) for each in models])[order] for key in ("Hx", "Hm", "r"))
    _, first, number = np.unique(slot, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return one._replace(Hx=Hx, Hm=Hm, r=r, step=step[order], slot=rank[number]), len(first)


if __name__ == "__main__":
    main()
