"""Comparison of `batch` with an independent least-squares solver, and of `causal` with that solver at every step.

The solver runs from several starts and keeps its lowest cost. Which landmarks bearings place is a matter of
definition: the solver gets those that `batch` has placed, on the whole recording or on its first steps. A landmark that
`batch` leaves out is an error if the true path places it well and the solver can map it.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
from scipy.special import chdtrc

from slamgauge.arrays import Float, Int
from slamgauge.ekf import riekf
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal, hindsight
from slamgauge.graph_baseline.problem.preparation import in_frame_of_start, prepare
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.incremental import IncrementalOptimum
from slamgauge.recording import Recording
from slamgauge.se2 import chain, wrap
from tests.reference.agreement import COST_BAR, STEP_BAR, Outcome, attempt
from tests.reference.drawn_recordings import Drawn
from tests.reference.least_squares import MAX_ITERATIONS, Minimum, Model, NoMinimumError, placed_only

WELL_PLACED = 0.05  # sigma over distance of a landmark that is placed for certain by bearings from the true path
PLACED = 0.3  # the same by bearings from the path of a minimum with the landmark
UNLIKELY = 5e-4  # probability of larger residuals, below which noise does not explain them
SMALLEST_SIGMA = 1e-6  # m or rad; lower limit of sigmas in comparisons
PERTURBED = 3  # starts
PREFIX_ITERATIONS = 50


def judge_optima(drawn: Drawn) -> list[Outcome]:
    """Return the outcomes of `batch` and `causal`, with bearings also of the landmarks that `batch` leaves out."""
    batched = attempt(batch, drawn.recording)
    recording = drawn.recording
    outcomes: list[Outcome] = []
    if recording.sensor == "bearing":
        if not isinstance(batched, str):
            outcomes.append(_judge_map(drawn, batched))
        placed = _well_placed(drawn) if isinstance(batched, str) else batched.landmark_ids
        recording = placed_only(recording, placed)
    model = Model(recording)
    minimum = lowest(model, starts(model, drawn.truth.poses, batched))
    outcomes.append(_judge_batch(model, minimum, batched))
    outcomes.append(_judge_causal(drawn, model, minimum))
    return outcomes


# --- the reference's minimum -------------------------------------------------------------------------


def starts(model: Model, truth: Float | None, batched: Estimate | str) -> Iterator[Float]:
    """Yield starts: dead reckoning, the truth, points near it, the right-invariant filter, the result of `batch`."""
    yield from own_starts(model, truth)
    if not isinstance(batched, str) and np.array_equal(np.sort(batched.landmark_ids), model.ids):
        yield of_estimate(model, batched)


def own_starts(model: Model, truth: Float | None) -> Iterator[Float]:
    """Yield the starts that need no result of `batch`; they also serve the first steps of a recording."""
    recording = model.recording
    yield model.start(model.relative(chain(recording.prior_mean, recording.odometry)))
    true = None if truth is None else model.start(model.relative(truth[: recording.steps + 1]))
    if true is not None:
        yield true
    filtered = attempt(riekf, recording)
    if not isinstance(filtered, str):
        yield model.start(model.relative(filtered.poses))
    if true is not None:
        rng = np.random.default_rng(len(true))
        for _ in range(PERTURBED):
            yield np.concatenate([0.5 * rng.normal(size=model.noises), true[model.noises :]])


def of_estimate(model: Model, estimate: Estimate) -> Float:
    """Return the unknowns of an estimate that has all landmarks of the model."""
    order = np.argsort(estimate.landmark_ids)
    return model.unknowns(model.relative(estimate.poses), model.relative(estimate.landmarks)[order])


def lowest(model: Model, begin: Iterable[Float], iterations: int = MAX_ITERATIONS) -> Minimum | None:
    """Return the lowest minimum found from the starts, None if no start ends in a minimum."""
    found: list[Minimum] = []
    for start in begin:
        try:
            found.append(model.minimum(start, iterations))
        except (NoMinimumError, np.linalg.LinAlgError, ValueError):
            continue
    return min(found, key=lambda each: each.cost, default=None)


# --- batch -----------------------------------------------------------------------------------------


def _judge_batch(model: Model, minimum: Minimum | None, batched: Estimate | str) -> Outcome:
    if isinstance(batched, str):
        verdict = "undecided" if minimum is None else "failed"
        return Outcome("batch", verdict, math.inf, batched)
    if minimum is None:
        return Outcome("batch", "undecided", math.nan, "the reference found no minimum")
    unknowns = of_estimate(model, batched)
    cost = model.cost(unknowns)
    higher = (cost - minimum.cost) / max(minimum.cost, 1.0)
    assert batched.pose_covs is not None
    apart = _in_sigmas(model, model.relative(batched.poses), model.poses(minimum.unknowns), batched.pose_covs)
    note = f"cost {cost:.6g}, reference {minimum.cost:.6g}, poses {apart:.1e} sigma, {fit(model, minimum)}"
    return Outcome("batch", "worse" if not higher <= COST_BAR else "agrees", higher, note)


def fit(model: Model, minimum: Minimum) -> str:
    """Return a text with chi-square of the optimum over its degrees of freedom."""
    freedom = _freedom(model)
    return f"chi2/dof {2 * minimum.cost / freedom:.3g}" if freedom else "no degrees of freedom"


def _freedom(model: Model) -> int:
    """Return the number of observed values minus the unknowns of their landmarks."""
    return model.recording.observation.size - 2 * len(model.ids)


def _in_sigmas(model: Model, poses: Float, others: Float, covs: Float) -> float:
    """Return the largest |d_i| / sigma_i over poses (n, 3) with covariances (n, 3, 3)."""
    apart = poses - others
    apart[:, 2] = wrap(apart[:, 2])
    sigma = np.sqrt(np.maximum(np.diagonal(covs, axis1=-2, axis2=-1), 0.0))
    floor = max(SMALLEST_SIGMA, 1e3 * float(np.spacing(np.abs(model.origin).max())))
    return float((np.abs(apart) / np.maximum(sigma, floor)).max())


def _judge_map(drawn: Drawn, batched: Estimate) -> Outcome:
    """Compare the landmarks that `batch` leaves out with those that the reference can map.

    The reference can map a landmark if a minimum with its bearings exists in which they place it. If the stated noise
    explains the minimum without these bearings but not the one with them, they are outliers and are left out rightly.
    """
    left = np.setdiff1d(_well_placed(drawn), batched.landmark_ids)
    if not len(left):
        return Outcome("batch mapped", "agrees")
    solved = sum(_can_map(drawn, batched, int(name)) for name in left)
    note = f"{len(left)} landmarks are not mapped though the true path places them; the reference can map {solved}"
    return Outcome("batch mapped", "worse" if solved else "undecided", solved, note)


def _can_map(drawn: Drawn, batched: Estimate, name: int) -> bool:
    model = Model(placed_only(drawn.recording, np.union1d(batched.landmark_ids, [name])))
    minimum = lowest(model, starts(model, drawn.truth.poses, batched))
    if minimum is None:
        return False
    landmark = model.landmarks(minimum.unknowns)[np.searchsorted(model.ids, name)]
    without = Model(placed_only(drawn.recording, batched.landmark_ids))
    assert batched.chi_square is not None
    is_outlier = _is_explained(without, batched.chi_square) and not _is_explained(model, 2.0 * minimum.cost)
    placed = _placed(model.recording, name, landmark, model.poses(minimum.unknowns), PLACED)
    return placed and not is_outlier


def _is_explained(model: Model, chi_square: float) -> bool:
    freedom = _freedom(model)
    return freedom == 0 or float(chdtrc(freedom, chi_square)) > UNLIKELY


def _well_placed(drawn: Drawn) -> Int:
    """Return the landmarks that bearings from the true path place for certain."""
    truth, recording = drawn.truth, drawn.recording
    assert truth.poses is not None and truth.landmarks is not None and recording.landmark is not None
    names = np.unique(recording.landmark).tolist()
    placed = [_placed(recording, name, truth.landmarks[name], truth.poses, WELL_PLACED) for name in names]
    return np.array(names, dtype=np.int64)[np.array(placed, dtype=bool)]


def _placed(recording: Recording, name: int, landmark: Float, poses: Float, share: float) -> bool:
    """Return whether bearings from a path place a landmark to a share of its smallest distance."""
    rows = recording.landmark == name
    offset = landmark - poses[recording.observation_step[rows], :2]
    squared = (offset**2).sum(axis=1)
    across = np.column_stack([-offset[:, 1], offset[:, 0]]) / squared[:, None]
    information = across.T @ (across / recording.observation_cov[rows, 0])
    return float(np.linalg.eigvalsh(information)[0]) * share**2 * float(squared.min()) > 1.0


# --- causal -----------------------------------------------------------------------------------------


@dataclass
class _Steps:
    """Comparison of the steps of `causal` so far.

    Attributes:
        look_again: first step at which a difference leads to a new search from all starts. A minimum that such a
            search has confirmed is rarely not the lowest a few steps later.
    """

    compared: int = 0
    off: int = 0
    worst: float = 0.0
    at: int = 0
    look_again: int = 0

    def add(self, step: int, apart: float) -> None:
        self.compared += 1
        self.off += not apart <= STEP_BAR
        if not apart <= self.worst:
            self.worst, self.at = apart, step


def stated_check(estimate: Estimate) -> float:
    """Return the estimate's own check of its distance to the optimum [sigma], nan if it has none."""
    return math.nan if estimate.optimum_check is None else estimate.optimum_check


def _judge_causal(drawn: Drawn, model: Model, minimum: Minimum | None) -> Outcome:
    estimate = attempt(causal, drawn.recording)
    if isinstance(estimate, str):
        if minimum is None:
            return Outcome("causal", "undecided", math.inf, estimate)
        count = drawn.recording.steps + 1  # all steps are missing
        return Outcome("causal", "failed", math.inf, estimate, count, count)
    steps = _Steps()
    warm: tuple[Model, Float] | None = None
    with grown_once(drawn.recording):
        for k in range(drawn.recording.steps + 1):
            whole = model if k == drawn.recording.steps else None
            part = whole or _prefix(drawn, k)
            if part is not None:
                warm = _judge_step(drawn, part, warm, estimate, steps, minimum if whole else None)
    if not steps.compared:
        return Outcome("causal", "undecided", math.nan, "the reference found no minimum at any step")
    verdict = "worse" if steps.off else "agrees"
    said = stated_check(estimate)
    unflagged = steps.off if not said > STEP_BAR else 0
    note = f"worst at step {steps.at} of {drawn.recording.steps}, {steps.off} of {steps.compared} off"
    note += ", without a flag" * bool(unflagged)
    return Outcome("causal", verdict, steps.worst, note, steps.compared, steps.off, unflagged)


@contextmanager
def grown_once(recording: Recording) -> Generator[None, None, None]:
    """Context in which `batch` on first steps of a bearing-only recording takes its start from one incremental run.

    Without it, `batch` computes the same start again for every number of steps.
    """
    starts: list[tuple[Float, Float]] = []
    if recording.sensor == "bearing":
        here = in_frame_of_start(recording)
        growing = IncrementalOptimum(here)
        for k in range(recording.steps + 1):
            growing.add_step()
            if not growing.converged:
                break
            starts.append(hindsight.start_of(growing, prepare(here.first(k))))

    def growing_start(part: Recording) -> tuple[Float, Float]:
        if part.steps < len(starts):
            return starts[part.steps]
        raise UndeterminedError("the first steps have no minimum of their own")

    with patch.object(hindsight, "incremental_start", growing_start if starts else hindsight.incremental_start):
        yield


def _prefix(drawn: Drawn, steps: int) -> Model | None:
    """Return the problem of the first steps, for bearing-only recordings with the landmarks that `batch` places."""
    part = drawn.recording.first(steps)
    if part.sensor != "bearing":
        return Model(part)
    batched = attempt(batch, part)
    return None if isinstance(batched, str) else Model(placed_only(part, batched.landmark_ids))


def _judge_step(
    drawn: Drawn,
    part: Model,
    warm: tuple[Model, Float] | None,
    estimate: Estimate,
    steps: _Steps,
    known: Minimum | None,
) -> tuple[Model, Float] | None:
    """Compare the newest pose with the optimum of the first steps, and return the start for the next step."""
    step = part.recording.steps
    minimum = known or lowest(part, [carried(part, warm)], PREFIX_ITERATIONS)
    apart = math.inf if minimum is None else _newest_apart(part, minimum, estimate)
    if apart > STEP_BAR and known is None and (minimum is None or step >= steps.look_again):
        batched = attempt(batch, part.recording)
        more = lowest(part, starts(part, drawn.truth.poses, batched), PREFIX_ITERATIONS)
        confirmed = minimum is not None and (more is None or more.cost > minimum.cost * (1.0 - COST_BAR))
        steps.look_again = step + 1 + step // 4 if confirmed else step + 1
        minimum = min((each for each in (minimum, more) if each), key=lambda each: each.cost, default=None)
        apart = math.inf if minimum is None else _newest_apart(part, minimum, estimate)
    if minimum is None:
        return warm
    steps.add(step, apart)
    return part, minimum.unknowns


def carried(part: Model, warm: tuple[Model, Float] | None) -> Float:
    """Return a start from the optimum of fewer steps, continued by odometry and first observations."""
    recording = part.recording
    if warm is None:
        return part.start(part.relative(chain(recording.prior_mean, recording.odometry)))
    before, unknowns = warm
    noise = np.concatenate([unknowns[: before.noises], np.zeros(part.noises - before.noises)])
    bare = np.concatenate([noise, np.zeros(2 * len(part.ids))])
    landmarks = part.sighted(part.poses(bare))
    known = np.isin(part.ids, before.ids)
    landmarks[known] = before.landmarks(unknowns)[np.searchsorted(before.ids, part.ids[known])]
    return np.concatenate([noise, landmarks.ravel()])


def _newest_apart(part: Model, minimum: Minimum, estimate: Estimate) -> float:
    """Return the distance of the newest pose from the optimum in sigmas of the optimum."""
    step = part.recording.steps
    try:
        cov = part.pose_cov(step, minimum.unknowns, part.factored(minimum.unknowns)[0])
    except np.linalg.LinAlgError:
        return math.inf
    pose = part.relative(estimate.poses[step : step + 1])
    return _in_sigmas(part, pose, part.poses(minimum.unknowns)[-1:], cov[None])
