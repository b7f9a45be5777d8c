"""Random recordings of all kinds, each drawn from the noise that the recording states.

The sigmas of start, motion and sensor are log-uniform between `SMALLEST` and `LARGEST`, independent of each other.
Each recording of a seed has a separate random generator, so that it can be drawn alone. Tags describe its kind.

The motion noise is drawn in one of two ways, which agree to first order in noise and turn. `additive` is the model of
the filters: between(true poses) = odometry + w. `exponential` is the model of the graph: between(true poses) =
odometry Exp(w). In both, w = B xi with B B' = Q, so that a direction without variance has no noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast, get_args

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.recording import Recording
from slamgauge.se2 import compose, rotation, wrap
from slamgauge.sensors import Sensor
from slamgauge.truth import Truth
from tests.reference.least_squares import exp_se2

SENSORS = get_args(Sensor)
PRIORS = ("zero", "diagonal", "full")
CONVENTIONS = ("additive", "exponential")
SMALLEST, LARGEST = 1e-4, 1.0  # sigmas [m, rad]
LARGEST_ANGLE = 0.3  # sigma [rad]; larger errors of heading or bearing are not Gaussian
KNOWN_SCALE = 0.1  # largest sigma of a step over its length in bearing-only recordings
MAX_STEPS = 100
STEP = 0.1  # s
MAX_OBSERVATIONS = 500  # dense references take seconds for more
REACH = 12.0  # m; largest distance of an observation
TOO_CLOSE = 0.05  # m; smallest distance of an observation
POSITIVE_RANGE = 6.0  # smallest range in sigmas, so that noise never makes it negative


@dataclass(frozen=True)
class Drawn:
    """A recording, its truth, and tags that describe its kind."""

    tags: tuple[str, ...]
    truth: Truth
    recording: Recording


def draw(seed: int, number: int) -> Drawn:
    """Draw recording `number` of `seed`."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    sensor, convention = _choice(rng, SENSORS), _choice(rng, CONVENTIONS)
    kind, odometry, roots = _motion(rng, sensor)
    prior, start, prior_cov, mean = _start(rng)
    noise = np.einsum("nij,nj->ni", roots, rng.normal(size=odometry.shape))
    moves = odometry + noise if convention == "additive" else compose(odometry, exp_se2(noise))
    path = [start]
    for increment in moves:
        path.append(compose(path[-1], increment))
    poses = np.array(path)
    landmarks = _landmarks(rng, poses)
    sigmas = _observation_sigmas(rng, sensor)
    step, landmark = _observations(rng, poses, landmarks, POSITIVE_RANGE * sigmas[0] * (sensor != "bearing"))
    offset = landmarks[landmark] - poses[step, :2]
    observation, covs = _observed(rng, sensor, sigmas, np.einsum("mji,mj->mi", rotation(poses[step, 2]), offset))
    recording = Recording(
        stamps=STEP * np.arange(len(poses), dtype=np.float64),
        prior_mean=mean,
        prior_cov=prior_cov,
        odometry=odometry,
        odometry_cov=roots @ roots.swapaxes(1, 2),
        sensor=cast("Sensor", sensor),
        observation_step=step,
        observation=observation,
        observation_cov=covs,
        landmark=landmark,
    )
    truth = Truth(poses=poses, landmark_ids=np.arange(len(landmarks)), landmarks=landmarks, association=landmark)
    return Drawn((sensor, convention, f"motion {kind}", f"prior {prior}"), truth, recording)


# --- motion and start ----------------------------------------------------------------------------


def _motion(rng: np.random.Generator, sensor: str) -> tuple[str, Float, Float]:
    """Draw the kind of noise, the measured motion (N, 3), and roots (N, 3, 3) of the noise of every step.

    Bearing-only recordings get the scale of the map from odometry alone. If the odometry noise is as large as the
    motion, the cost falls while the whole map shrinks into the robot, and no proper optimum exists.
    """
    steps = int(np.clip(round(_log_uniform(rng, 2, MAX_STEPS)), 2, MAX_STEPS))
    forward = rng.uniform(0.1, 1.0) * rng.uniform(0.5, 1.5, steps)
    turn = rng.normal(0.0, 0.1) + rng.uniform(0.0, 0.3) * rng.normal(size=steps)
    increments = np.column_stack([forward, np.zeros(steps), turn])
    sigmas = _pose_sigmas(rng)
    if sensor == "bearing":
        sigmas[:2] = np.minimum(sigmas[:2], KNOWN_SCALE * forward.mean())
    kind = _choice(rng, (*MOTIONS, "mixed"))
    roots = np.empty((steps, 3, 3))
    for k in range(steps):
        chosen = _choice(rng, tuple(MOTIONS)) if kind == "mixed" else kind
        roots[k] = MOTIONS[chosen](rng, sigmas, increments[k])
    if rng.random() < 0.2:
        roots[rng.random(steps) < 0.3] = 0.0
    return kind, increments, roots


def _full(rng: np.random.Generator, sigmas: Float, _: Float) -> Float:
    return sigmas[:, None] * (np.eye(3) + 0.3 * rng.normal(size=(3, 3)))


def _correlated(rng: np.random.Generator, sigmas: Float, _: Float) -> Float:
    """Return a root of full rank, with correlations of about 0.99."""
    common = np.outer(rng.choice([-1.0, 1.0], 3), [1.0, 0.0, 0.0])
    return sigmas[:, None] * (common + 0.1 * np.eye(3))


def _without_slip(_: np.random.Generator, sigmas: Float, __: Float) -> Float:
    return np.diag(sigmas * [1.0, 0.0, 1.0])


def _of_controls(_: np.random.Generator, sigmas: Float, increment: Float) -> Float:
    """Return a root of rank 2: speed and yaw rate have noise, and the arc that they describe is exact."""
    length, half = increment[0], increment[2] / 2
    root = np.zeros((3, 3))
    root[:, 0] = sigmas[0] * np.array([np.cos(half), np.sin(half), 0.0])
    root[:, 1] = sigmas[2] * np.array([-length / 2 * np.sin(half), length / 2 * np.cos(half), 1.0])
    return root


def _rank_one(rng: np.random.Generator, sigmas: Float, _: Float) -> Float:
    """Return a root of rank 1: speed and yaw rate fully correlated, one of them alone, or another direction."""
    lines = ([1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0])
    return np.outer(sigmas * np.array(lines[rng.integers(len(lines))]), [1.0, 0.0, 0.0])


MOTIONS: dict[str, Callable[[np.random.Generator, Float, Float], Float]] = {
    "full": _full,
    "correlated": _correlated,
    "without slip": _without_slip,
    "of controls": _of_controls,
    "rank 1": _rank_one,
}


def _start(rng: np.random.Generator) -> tuple[str, Float, Float, Float]:
    """Draw the kind of prior, the start pose, and the prior's covariance and mean."""
    kind = _choice(rng, PRIORS)
    sigmas = _pose_sigmas(rng)
    root = {"zero": np.zeros((3, 3)), "diagonal": np.diag(sigmas), "full": _full(rng, sigmas, sigmas)}[kind]
    mean = np.array([*rng.uniform(-5.0, 5.0, 2), rng.uniform(-np.pi, np.pi)])
    if rng.random() < 0.2:
        direction = rng.uniform(-np.pi, np.pi)
        mean[:2] = _log_uniform(rng, 1e3, 1e5) * np.array([np.cos(direction), np.sin(direction)])
    start = mean + root @ rng.normal(size=3)
    start[2] = wrap(start[2])
    return kind, start, root @ root.T, mean


def _pose_sigmas(rng: np.random.Generator) -> Float:
    """Draw sigmas (3,) [m, m, rad]."""
    position = _log_uniform(rng, SMALLEST, LARGEST)
    sideways = np.clip(position * _log_uniform(rng, 0.3, 3.0), SMALLEST, LARGEST)
    heading = np.clip(position * _log_uniform(rng, 0.03, 0.3), SMALLEST, LARGEST_ANGLE)
    return np.array([position, sideways, heading])


# --- landmarks and observations ------------------------------------------------------------------------


def _landmarks(rng: np.random.Generator, poses: Float) -> Float:
    """Draw landmarks (L, 2) near the path, in clusters in some recordings."""
    count = int(rng.integers(2, 16))
    is_clustered = rng.random() < 0.3
    centres = max(1, count // 4) if is_clustered else count
    beside = poses[rng.integers(0, len(poses), centres), :2]
    direction, distance = rng.uniform(-np.pi, np.pi, centres), rng.uniform(1.0, 8.0, centres)
    centre = beside + distance[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    if not is_clustered:
        return centre
    spread = _log_uniform(rng, 1e-3, 0.5)
    return centre[rng.integers(0, centres, count)] + spread * rng.normal(size=(count, 2))


def _observations(rng: np.random.Generator, poses: Float, landmarks: Float, nearest: float) -> tuple[Int, Int]:
    """Draw steps (M,) and landmarks (M,) of the observations, in the order of steps, in random order within a step.

    Some recordings have a stretch of a third to all but one of the steps without observations, or landmarks that a
    scan observes twice.
    """
    distance = np.hypot(*np.moveaxis(landmarks - poses[:, None, :2], -1, 0))
    visible = (distance < REACH) & (distance > max(nearest, TOO_CLOSE))
    share = min(rng.uniform(0.2, 0.9), MAX_OBSERVATIONS / max(1, visible.sum()))
    times = (visible & (rng.random(visible.shape) < share)).astype(np.int64)
    if rng.random() < 0.4:
        length = int(rng.integers(max(1, len(poses) // 3), len(poses)))
        first = int(rng.integers(0, len(poses) - length + 1))
        times[first : first + length] = 0
    if rng.random() < 0.3:
        times[(times > 0) & (rng.random(times.shape) < 0.15)] = 2
    step, landmark = (np.repeat(each, times[times > 0]) for each in np.nonzero(times))
    order = np.lexsort([rng.random(len(step)), step])
    return step[order], landmark[order]


def _observation_sigmas(rng: np.random.Generator, sensor: str) -> Float:
    """Draw sigmas (d,) in the sensor's units."""
    distance = _log_uniform(rng, SMALLEST, LARGEST)
    bearing = np.clip(distance * _log_uniform(rng, 0.03, 1.0), SMALLEST, LARGEST_ANGLE)
    second = np.clip(distance * _log_uniform(rng, 0.3, 3.0), SMALLEST, LARGEST)
    by_sensor = {"range-bearing": [distance, bearing], "position": [distance, second], "bearing": [min(bearing, 0.1)]}
    return np.array(by_sensor[sensor])


def _observed(rng: np.random.Generator, sensor: str, sigmas: Float, delta: Float) -> tuple[Float, Float]:
    """Draw observations (M, d) of landmarks (M, 2) in the body frame [m], and their covariances (M, d, d)."""
    count, dim = len(delta), len(sigmas)
    polar = np.column_stack([np.hypot(*delta.T), np.arctan2(delta[:, 1], delta[:, 0])])
    exact = delta if sensor == "position" else polar[:, -dim:]
    lean = np.tril(rng.uniform(-0.5, 0.5) * np.ones((dim, dim)), -1) * (rng.random() < 0.5)
    scale = rng.uniform(0.5, 1.0, (count, 1, 1))  # at most 1, for which the smallest range is chosen
    roots = scale * sigmas[:, None] * (np.eye(dim) + lean)
    value = exact + np.einsum("mij,mj->mi", roots, rng.normal(size=(count, dim)))
    if sensor != "position":
        value[:, -1] = wrap(value[:, -1])
    return value, roots @ roots.swapaxes(1, 2)


def _choice(rng: np.random.Generator, names: tuple[str, ...]) -> str:
    return names[int(rng.integers(len(names)))]


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
