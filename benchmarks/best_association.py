"""How often even the best association of bearings is wrong; one table.

    python benchmarks/best_association.py [--runs 20] [--seed 100] [--sigmas 1,2,5]

`q4-ring` with bearings of these sigmas. A filter is told which landmark it sees, and so knows as much as one without
ids at best. Before it is told, each scan's bearings are given to its landmarks jointly, one each, such that the
likelihood of the scan is greatest: the share that is given to another landmark than their own is an error that nobody
can avoid who decides scan by scan. Of a ray that member counts which makes a bearing likeliest. `scans` is the share of
scans in which at least one is wrong.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.optimize import linear_sum_assignment

from slamgauge import BearingFilter, Rays, load_scenario, simulate
from slamgauge.arrays import Float, Int
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.ekf.maps.matching import innovations
from slamgauge.recording import Observations, Recording


class Told(BearingFilter):
    """A filter that is told which landmark it sees, and asked before."""

    def costs(self, bearings: Float, variances: Float) -> tuple[Int, Float]:
        """Landmarks (L,), and minus twice the log likelihoods (m, L) of bearings (m,) [rad] being theirs."""
        owners = self._owners()
        slots = np.tile(np.arange(len(owners)), len(bearings))
        values, covs = (np.repeat(each, len(owners)) for each in (bearings, variances))
        innovation, S = innovations(self._map, slots, values[:, None], covs[:, None, None])
        shape = (len(bearings), len(owners))
        innovation, S = innovation.reshape(shape), S.reshape(shape)
        cost = innovation**2 / S + np.log(S)
        landmarks = np.unique(owners)
        of_landmarks = [cost[:, owners == each].min(axis=1) for each in landmarks]
        return landmarks, np.array(of_landmarks).reshape(len(landmarks), len(bearings)).T


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--sigmas", default="1,2,5")
    options = parser.parse_args()
    print(f"{'sigma [deg]':>12}{'bearings':>12}{'wrong %':>10}{'scans %':>10}{'first 100 steps %':>20}")
    for sigma in map(float, options.sigmas.split(",")):
        scenario = load_scenario("q4-ring", ["start=sampled", f"sensor.sigma_bearing_deg={sigma}"])
        runs = [errors(simulate(scenario, run_seed(options.seed, run))[1]) for run in range(options.runs)]
        step, given, wrong = np.concatenate(runs, axis=1)
        early = step < 100
        print(
            f"{sigma:12.0f}{given.sum():12}{100 * wrong.sum() / given.sum():10.2f}{100 * (wrong > 0).mean():10.1f}"
            f"{100 * wrong[early].sum() / given[early].sum():20.2f}",
            flush=True,
        )


def errors(recording: Recording) -> Int:
    """Rows step, bearings of landmarks that are known, and how many of these the best association has wrong."""
    assert recording.landmark is not None
    slam = Told(recording.prior_mean, recording.prior_cov, "right-invariant", Rays())
    found: list[tuple[int, int, int]] = []
    for step in range(recording.steps + 1):
        if step:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        rows = np.flatnonzero(recording.observation_step == step)
        ids, values, covs = recording.landmark[rows], recording.observation[rows], recording.observation_cov[rows]
        landmarks, cost = slam.costs(values[:, 0], covs[:, 0, 0])
        known = np.isin(ids, landmarks)
        if known.any():
            bearing, column = linear_sum_assignment(cost[known])
            found.append((step, len(bearing), int((landmarks[column] != ids[known][bearing]).sum())))
        slam.update(Observations(ids, values, covs))
    return np.array(found, dtype=np.int64).reshape(-1, 3).T


if __name__ == "__main__":
    main()
