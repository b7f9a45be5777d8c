"""Comparison of `batch` with an independent least-squares solver, and of `causal` with that solver at every step.

The solver runs from several starts and keeps its lowest cost. Which landmarks bearings place is a matter of
definition: the solver gets those that `batch` has placed, on the whole recording or on its first steps. A landmark that
`batch` leaves out is an error if the true path places it well and the solver can map it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
from scipy.special import chdtrc

from slamgauge.arrays import Float, Int
from slamgauge.ekf import riekf
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Recording
from slamgauge.se2 import chain, wrap
from tests.reference.agreement import COST_BAR, STEP_BAR, Outcome, attempt
from tests.reference.drawn_recordings import Drawn
from tests.reference.least_squares import EVALUATIONS, Minimum, Model, NoMinimumError, placed_only

WELL_PLACED = 0.05  # sigma over distance of a landmark that is placed for certain by bearings from the true path
PLACED = 0.3  # the same by bearings from the path of a minimum with the landmark
UNLIKELY = 5e-4  # probability of larger residuals, below which noise does not explain them
SMALLEST_SIGMA = 1e-6  # m or rad; lower limit of sigmas in comparisons
PERTURBED = 3  # starts
PREFIX_EVALUATIONS = 100


def judge_optima(drawn: Drawn) -> list[Outcome]:
    """Return the outcomes of `batch` and `causal`, with bearings also of the landmarks that `batch` leaves out."""
    recording, batched = drawn.recording, attempt(batch, drawn.recording)
    outcomes: list[Outcome] = []
    if recording.sensor == "bearing":
        if not isinstance(batched, str):
            outcomes.append(_judge_map(drawn, batched))
        recording = placed_only(recording, _well_placed(drawn) if isinstance(batched, str) else batched.landmark_ids)
    model = Model(recording)
    minimum = lowest(model, starts(model, drawn.truth.poses, batched))
    return [*outcomes, _judge_batch(model, minimum, batched), _judge_causal(drawn, model, minimum)]


# --- the reference's minimum -------------------------------------------------------------------------


def starts(model: Model, truth: Float | None, batched: Estimate | str) -> Iterator[Float]:
    """Yield starts: dead reckoning, the truth, points near it, the right-invariant filter, the result of `batch`."""
    recording = model.recording
    yield model.start(model.relative(chain(recording.prior_mean, recording.odometry)))
    filtered = attempt(riekf, recording)
    if not isinstance(filtered, str):
        yield model.start(model.relative(filtered.poses))
    if truth is not None:
        true = model.start(model.relative(truth[: recording.steps + 1]))
        yield true
        rng = np.random.default_rng(len(true))
        for _ in range(PERTURBED):
            yield np.concatenate([0.5 * rng.normal(size=model.noises), true[model.noises :]])
    if not isinstance(batched, str) and np.array_equal(np.sort(batched.landmark_ids), model.ids):
        yield of_estimate(model, batched)


def of_estimate(model: Model, estimate: Estimate) -> Float:
    """Return the unknowns of an estimate that has all landmarks of the model."""
    order = np.argsort(estimate.landmark_ids)
    return model.unknowns(model.relative(estimate.poses), model.relative(estimate.landmarks)[order])


def lowest(model: Model, begin: Iterable[Float], evaluations: int = EVALUATIONS) -> Minimum | None:
    """Return the lowest minimum found from the starts, None if no start ends in a minimum."""
    found: list[Minimum] = []
    for start in begin:
        try:
            found.append(model.minimum(start, evaluations))
        except (NoMinimumError, np.linalg.LinAlgError, ValueError):
            continue
    return min(found, key=lambda each: each.cost, default=None)


# --- batch -----------------------------------------------------------------------------------------


def _judge_batch(model: Model, minimum: Minimum | None, batched: Estimate | str) -> Outcome:
    if isinstance(batched, str):
        return Outcome("batch", "undecided" if minimum is None else "failed", math.inf, batched)
    if minimum is None:
        return Outcome("batch", "undecided", math.nan, "the reference found no minimum")
    cost = model.cost(of_estimate(model, batched))
    higher = (cost - minimum.cost) / max(minimum.cost, 1.0)
    note = f"cost {cost:.6g}, reference {minimum.cost:.6g}, {_freedom(model)} degrees of freedom"
    return Outcome("batch", "agrees" if higher <= COST_BAR else "worse", higher, note)


def _freedom(model: Model) -> int:
    """Return the number of observed values minus the unknowns of their landmarks."""
    return model.recording.observation.size - 2 * len(model.ids)


def _judge_map(drawn: Drawn, batched: Estimate) -> Outcome:
    """Compare the landmarks that `batch` leaves out with those that the reference can map."""
    left = np.setdiff1d(_well_placed(drawn), batched.landmark_ids)
    if not len(left):
        return Outcome("batch mapped", "agrees")
    solved = sum(_can_map(drawn, batched, int(name)) for name in left)
    note = f"{len(left)} landmarks are not mapped though the true path places them; the reference can map {solved}"
    return Outcome("batch mapped", "worse" if solved else "undecided", solved, note)


def _can_map(drawn: Drawn, batched: Estimate, name: int) -> bool:
    """Return whether a minimum with a landmark's bearings exists in which they place it.

    If the stated noise explains the minimum without these bearings but not the one with them, they are outliers.
    """
    model, without = (
        Model(placed_only(drawn.recording, ids))
        for ids in (np.union1d(batched.landmark_ids, [name]), batched.landmark_ids)
    )
    minimum = lowest(model, starts(model, drawn.truth.poses, batched))
    if minimum is None or batched.chi_square is None:
        return False
    if _is_explained(without, batched.chi_square) and not _is_explained(model, 2.0 * minimum.cost):
        return False
    landmark = model.landmarks(minimum.unknowns)[np.searchsorted(model.ids, name)]
    return _placed(model.recording, name, landmark, model.poses(minimum.unknowns), PLACED)


def _is_explained(model: Model, chi_square: float) -> bool:
    return _freedom(model) == 0 or float(chdtrc(_freedom(model), chi_square)) > UNLIKELY


def _well_placed(drawn: Drawn) -> Int:
    """Return the landmarks that bearings from the true path place for certain."""
    truth, recording = drawn.truth, drawn.recording
    assert truth.poses is not None and truth.landmarks is not None and recording.landmark is not None
    names = np.unique(recording.landmark)
    placed = [_placed(recording, name, truth.landmarks[name], truth.poses, WELL_PLACED) for name in names.tolist()]
    return names[np.array(placed, dtype=bool)]


def _placed(recording: Recording, name: int, landmark: Float, poses: Float, share: float) -> bool:
    """Return whether bearings from a path place a landmark to a share of its smallest distance."""
    rows = recording.landmark == name
    offset = landmark - poses[recording.observation_step[rows], :2]
    squared = (offset**2).sum(axis=1)
    across = np.column_stack([-offset[:, 1], offset[:, 0]]) / squared[:, None]
    information = across.T @ (across / recording.observation_cov[rows, 0])
    return float(np.linalg.eigvalsh(information)[0]) * share**2 * float(squared.min()) > 1.0


# --- causal -----------------------------------------------------------------------------------------


def _judge_causal(drawn: Drawn, model: Model, minimum: Minimum | None) -> Outcome:
    estimate, count = attempt(causal, drawn.recording), drawn.recording.steps + 1
    if isinstance(estimate, str):
        missing = 0 if minimum is None else count
        return Outcome("causal", "failed" if missing else "undecided", math.inf, estimate, missing, missing)
    apart: dict[int, float] = {}
    warm: tuple[Model, Float] | None = None
    for k in range(count):
        part = model if k == count - 1 else _first_steps(drawn, k)
        if part is None:
            continue
        found = minimum if part is model else lowest(part, [carried(part, warm)], PREFIX_EVALUATIONS)
        if part is not model and not _newest_apart(part, found, estimate) <= STEP_BAR:
            more = starts(part, drawn.truth.poses, attempt(batch, part.recording))
            both = (found, lowest(part, more, PREFIX_EVALUATIONS))
            found = min((each for each in both if each), key=lambda each: each.cost, default=None)
        if found is not None:
            apart[k], warm = _newest_apart(part, found, estimate), (part, found.unknowns)
    if not apart:
        return Outcome("causal", "undecided", math.nan, "the reference found no minimum at any step")
    off, worst = sum(not each <= STEP_BAR for each in apart.values()), max(apart, key=apart.__getitem__)
    is_flagged = estimate.optimum_check is not None and estimate.optimum_check > STEP_BAR
    note = f"worst at step {worst} of {count - 1}, {off} of {len(apart)} off" + ", flagged" * is_flagged
    verdict = "worse" if off else "agrees"
    return Outcome("causal", verdict, apart[worst], note, len(apart), off, 0 if is_flagged else off)


def _first_steps(drawn: Drawn, steps: int) -> Model | None:
    """Return the problem of the first steps, for bearing-only recordings with the landmarks that `batch` places."""
    part = drawn.recording.first(steps)
    if part.sensor != "bearing":
        return Model(part)
    batched = attempt(batch, part)
    return None if isinstance(batched, str) else Model(placed_only(part, batched.landmark_ids))


def carried(part: Model, warm: tuple[Model, Float] | None) -> Float:
    """Return a start from the optimum of fewer steps, continued by odometry and first observations."""
    recording = part.recording
    if warm is None:
        return part.start(part.relative(chain(recording.prior_mean, recording.odometry)))
    before, unknowns = warm
    start = part.drawn_start(np.append(unknowns[: before.noises], np.zeros(part.noises - before.noises)))
    known = np.isin(part.ids, before.ids)
    landmarks = part.landmarks(start)
    landmarks[known] = before.landmarks(unknowns)[np.searchsorted(before.ids, part.ids[known])]
    return start


def _newest_apart(part: Model, minimum: Minimum | None, estimate: Estimate) -> float:
    """Return the distance of the newest pose from the optimum in sigmas of the optimum, infinite without one."""
    if minimum is None:
        return math.inf
    step = part.recording.steps
    try:
        cov = part.pose_cov(step, minimum.unknowns, part.factored(minimum.unknowns)[0])
    except np.linalg.LinAlgError:
        return math.inf
    apart = part.relative(estimate.poses[step]) - part.poses(minimum.unknowns)[-1]
    apart[2] = wrap(apart[2])
    floor = max(SMALLEST_SIGMA, 1e3 * float(np.spacing(np.abs(part.origin).max())))
    return float((np.abs(apart) / np.maximum(np.sqrt(np.maximum(np.diag(cov), 0.0)), floor)).max())
