"""Whether the causal optimum is the best causal estimate: its error beside that of the posterior mean; one table.

    python benchmarks/posterior_mean.py [--scenario q4-ring] [--steps 50,150,300] [--runs 40] [--samples 2000]
                                        [--seed 100] [--jobs 2]

The optimum is the maximum of the posterior density. Its mean has the smallest mean squared error over all the maps that
the prior allows, which fill the plane: not on the one map of a scenario. Of the first steps of every run the newest
pose is compared: RMS position error of either, the ratio of the two with a 95 % interval, and in standard deviations of
the pose how far the two are apart (RMS) and how well the mean is known.

The mean is that of a preconditioned Crank-Nicolson walk (Cotter, Roberts, Stuart & White, Statistical Science 28(3),
2013) about the maximum. Proposals are drawn from the Gaussian of the linear model there; the walk accepts by what the
exact posterior adds, which is nothing where the model is linear, and `accepted` says how much of them.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
from functools import partial
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from slamgauge import Recording, load_scenario, local_processes, simulate
from slamgauge.arrays import Float
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.scoring.intervals import ratio_interval
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.covariances import square_roots
from slamgauge.errors import UserError
from slamgauge.graph_baseline import batch
from slamgauge.graph_baseline.problem.constrained_motion import FreeNoise
from slamgauge.graph_baseline.problem.linearisation import linearise, whitened_residuals
from slamgauge.graph_baseline.problem.retraction import driven
from slamgauge.graph_baseline.solver.reduced_scans import NOT_DAMPED
from slamgauge.graph_baseline.solver.smoother import damped_step
from slamgauge.se2 import wrap

BURN_IN = 0.25  # of the samples, before them; the walk's stride is fitted meanwhile
FITS = 20
WANTED = 0.35  # share of proposals that is accepted
BATCHES = 20  # of samples, whose means tell how well the mean is known

Step = tuple[Float, Float]  # of poses (N+1, 3) and landmarks (L, 2)


class Compared(NamedTuple):
    """Newest pose of a part of a run: squared position errors [m^2], apart and its standard error [sigma], accepted."""

    of_maximum: float
    of_mean: float
    apart: float
    unsure: float
    accepted: float


class Posterior:
    """The exact posterior of a recording about its maximum, poses (N+1, 3) and landmarks (L, 2), ids increasing.

    A step is taken by the noise of the motions, and moves landmarks with the pose that sees them first: the density
    of what such steps are made of is that of noise and landmarks, and the motions' part of it is a Gaussian.
    """

    def __init__(self, recording: Recording, poses: Float, landmarks: Float) -> None:
        assert recording.landmark is not None
        self._recording, self._poses, self._landmarks = recording, poses, landmarks
        self._slot = np.unique(recording.landmark, return_inverse=True)[1]
        self._noise = FreeNoise(recording)
        self._model = linearise(recording, self._slot, poses, landmarks)
        self._roots = square_roots(np.concatenate([self._model.start_cov[None], self._model.W]))

    def draw(self, rng: np.random.Generator) -> Step:
        """A step of the linear model's Gaussian: where its minimum goes when all that was measured errs once more."""
        start, *motions = np.einsum("nij,nj->ni", self._roots, rng.standard_normal((len(self._roots), 3)))
        seen = rng.standard_normal(self._model.r.shape)
        again = self._model._replace(start=start, c=np.array(motions), r=seen)
        return damped_step(again, len(self._landmarks), NOT_DAMPED)

    def moved(self, step: Step) -> Step:
        """Poses (N+1, 3) and landmarks (L, 2) after a step."""
        return driven(self._model, self._noise, self._poses, self._landmarks, *step)

    def at(self, step: Step) -> tuple[Float, float]:
        """Newest pose (3,) after a step, and how much more the exact posterior costs there than the linear model."""
        poses, landmarks = self.moved(step)
        exact = whitened_residuals(self._recording, self._slot, poses, landmarks)
        return poses[-1], 0.5 * float(np.square(exact).sum() - np.square(self._linear(*step)).sum())

    def _linear(self, dx: Float, dm: Float) -> Float:
        """What the linear model takes the whitened residuals (M, d) to be after a step."""
        model = self._model
        by_pose = np.einsum("mdi,mi->md", model.Hx, dx[model.step])
        return model.r + by_pose + np.einsum("mdi,mi->md", model.Hm, dm[model.slot])


class Walk:
    """A preconditioned Crank-Nicolson walk through a posterior, begun at its maximum."""

    def __init__(self, posterior: Posterior, begin: Step, seed: int) -> None:
        self._posterior, self._rng = posterior, np.random.default_rng(seed)
        self._step = begin
        self._pose, self._cost = posterior.at(begin)

    def go(self, samples: int, stride: float) -> tuple[Float, float]:
        """Newest poses (samples, 3) on the way, and the share of proposals that is accepted."""
        poses, accepted, keep = np.empty((samples, 3)), 0, np.sqrt(1.0 - stride**2)
        for i in range(samples):
            drawn = self._posterior.draw(self._rng)
            tried: Step = (keep * self._step[0] + stride * drawn[0], keep * self._step[1] + stride * drawn[1])
            pose, cost = self._posterior.at(tried)
            if np.log(self._rng.random()) < self._cost - cost:
                self._step, self._pose, self._cost, accepted = tried, pose, cost, accepted + 1
            poses[i] = self._pose
        return poses, accepted / samples


def sampled(posterior: Posterior, begin: Step, samples: int, seed: int) -> tuple[Float, float]:
    """Newest poses (samples, 3) of a walk after its burn-in, and the share of proposals that is accepted."""
    walk, stride = Walk(posterior, begin, seed), 0.5
    for _ in range(FITS):
        accepted = walk.go(max(int(BURN_IN * samples / FITS), 1), stride)[1]
        stride = float(np.clip(stride * np.exp(accepted - WANTED), 0.01, 1.0))
    return walk.go(samples, stride)


def compare(scenario_name: str, parts: list[int], samples: int, seed: int, run: int) -> list[Compared | None]:
    """A run's parts of so many steps; None where there is no optimum."""
    truth, recording = simulate(informed(load_scenario(scenario_name, ["start=sampled"])), run_seed(seed, run))
    return [_compare(truth.poses, recording.first(steps), samples, run) for steps in parts]


def _compare(true_poses: Float | None, part: Recording, samples: int, seed: int) -> Compared | None:
    try:
        optimum = batch(part)
    except UserError:
        return None
    assert true_poses is not None and optimum.association is not None and optimum.pose_covs is not None
    seen = part.associated(optimum.association)
    posterior = Posterior(seen, optimum.poses, optimum.landmarks)
    begin = np.zeros_like(optimum.poses), np.zeros_like(optimum.landmarks)
    poses, accepted = sampled(posterior, begin, samples, seed)
    apart = poses - optimum.poses[-1]
    apart[:, 2] = wrap(apart[:, 2])
    sigma = np.sqrt(np.diagonal(optimum.pose_covs[-1]))
    mean = apart.mean(axis=0)
    by_batch = np.array([each.mean(axis=0) for each in np.array_split(apart, BATCHES)])
    error = optimum.poses[-1, :2] - true_poses[part.steps, :2]
    return Compared(
        of_maximum=float(np.square(error).sum()),
        of_mean=float(np.square(error + mean[:2]).sum()),
        apart=float(np.sqrt(np.mean(np.square(mean / sigma)))),
        unsure=float(np.sqrt(np.mean(np.square(by_batch.std(axis=0, ddof=1) / sigma)) / BATCHES)),
        accepted=accepted,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="q4-ring")
    parser.add_argument("--steps", default="50,150,300")
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--samples", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    parts = [int(each) for each in options.steps.split(",")]
    work = partial(compare, options.scenario, parts, options.samples, options.seed)
    with local_processes(options.jobs) as executor:
        by_run = [*tqdm(executor.map(work, range(options.runs)), total=options.runs, disable=None)]
    heads = f"{'maximum [m]':>13}{'mean [m]':>10}{'mean / maximum':>23}{'apart':>8}{'unsure':>8}{'accepted':>9}"
    print(f"{'scenario':20}{'step':>5}{'runs':>5}{heads}")
    for steps, each in zip(parts, zip(*by_run, strict=True), strict=True):
        rows = np.array([row for row in each if row is not None])
        print(f"{options.scenario:20}{steps:5d}{len(rows):5d}{_row(rows) if len(rows) else ''}")


def _row(rows: Float) -> str:
    """Of runs (n, 5), the fields of `Compared`."""
    maximum, mean, _, _, accepted = rows.mean(axis=0)
    apart, unsure = np.sqrt(np.square(rows[:, 2:4]).mean(axis=0))
    ratio = ratio_interval(rows[:, 1], rows[:, 0])
    assert ratio is not None
    low, high = (np.nan if end is None else np.sqrt(max(end, 0.0)) for end in (ratio.low, ratio.high))
    line = f"{np.sqrt(maximum):13.4f}{np.sqrt(mean):10.4f}{np.sqrt(ratio.mean):8.3f} [{low:.3f}, {high:.3f}]"
    return f"{line}{apart:8.3f}{unsure:8.3f}{accepted:9.0%}"


if __name__ == "__main__":
    main()
