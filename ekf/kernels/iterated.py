"""The iterated update: Gauss-Newton on the prior and the observations of a step, ended at a minimum of their cost.

The cost is c(x) = (x - x^)' P^-1 (x - x^) + v' R^-1 v, with innovations v = z - h(x). A pass linearises at the place
where it is, and aims at the least linearised cost: x^ + K r with r = v + H (place - x^). Where that place costs more,
half of the way is taken, and half of that again: the way leads downhill, so one of them costs less. Close to the
minimum costs are all alike; what swings about it, its passes as long as those before, then takes smaller shares.

P may be singular: every place is x^ + P p for some p. That of the aim is p = H' l, with l = R^-1 (r - H dx), so that
along the way from a place with prior cost a to the aim, the prior costs

    (1 - s)^2 a + 2 s (1 - s) l' H (place - x^) + s^2 l' H dx

and no inverse of P is needed. Source: Bell and Cathey, IEEE Transactions on Automatic Control 38(2), 1993.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT, Belief, at_place
from slamgauge.ekf.kernels.compiled import combine_rows, kernel, subtract_gram
from slamgauge.ekf.kernels.covariance import mirror_robot_block, noise, squared_distance
from slamgauge.ekf.kernels.linearisation import linearise, subtract_projection
from slamgauge.ekf.kernels.models import wrap
from slamgauge.ekf.kernels.take_in import are_sound, whiten
from slamgauge.ekf.kernels.workspace import CORRECTION, PLACE, TRIAL, WAY_BACK, Workspace

MAX_ITERATIONS = 500
PATIENCE = 20  # passes that go all the way if they can
SETTLED = 1e-12  # m or rad: an iterate that moves less has arrived
SMALLEST = 0.1  # share of the way to which swinging reduces it
SHORTEST = 1e-9  # share of the way below which nothing is gained
ROUNDING = 1e-10  # of costs, relative


class Seen(NamedTuple):
    """Observations (m,), linearised at some place."""

    sensor: int
    slots: Int  # (m,)
    observation: Float  # (m, 2)
    observation_cov: Float  # (m, 2, 2)
    innovation: Float  # (2m,)
    jacobian: Float  # (2m, 5)


class Way(NamedTuple):
    """Where an iterate is, and where it goes; all (capacity,)."""

    place: Float  # where it is
    trial: Float  # where it may go
    dx: Float  # from the prior to the least linearised cost


@kernel
def update_iterated(sensor: int, belief: Belief, count: int, work: Workspace) -> tuple[float, int]:
    """Correct with Jacobians where the correction leads; returns as `update_standard`, the NIS of the first pass."""
    return iterate(sensor, belief, count, work, MAX_ITERATIONS)


@kernel
def iterate(sensor: int, belief: Belief, count: int, work: Workspace, iterations: int) -> tuple[float, int]:
    """`update_iterated` with at most `iterations` passes; a single one is the standard update.

    The workspace must take in a whole scan at a time; if it does not, there is no update.
    """
    state, size, back = belief.state, belief.size, work.scratch[WAY_BACK]
    seen = Seen(
        sensor,
        work.slots[:count],
        work.observation[:count],
        work.observation_cov[:count],
        work.innovation[: 2 * count],
        work.jacobian[: 2 * count],
    )
    way = Way(work.scratch[PLACE], work.scratch[TRIAL], work.scratch[CORRECTION])
    if 2 * count > len(work.W) or not are_sound(sensor, seen.observation, seen.observation_cov):
        return math.nan, 0
    way.place[:size] = state[:size]
    informative = linearise_at(way.place, belief, seen)
    of_prior, cost = 0.0, misfit(seen)
    first_nis, share, last, settled = 0.0, 1.0, math.inf, math.inf if iterations == 1 else SETTLED
    for iteration in range(iterations):
        for i in range(size):
            back[i] = state[i] - way.place[i]
        subtract_projection(back, 0, count, work)
        r = seen.innovation.copy()
        nis = whiten(belief, 0, count, work)
        if not math.isfinite(nis):
            return math.nan, informative
        if iteration == 0:
            first_nis = nis
        combine_rows(work.W, work.innovation, way.dx, 2 * count, size)
        change, of_prior, cost = go_downhill(belief, seen, way, r, share, of_prior, cost, settled)
        if change < settled:
            break
        share, last = smaller_share(share, iteration, change, last), change
    state[:size] = way.place[:size]
    state[2] = wrap(state[2])
    subtract_gram(belief.cov, work.W, 2 * count, size)
    mirror_robot_block(belief.cov)
    return first_nis, informative


@kernel
def go_downhill(
    belief: Belief, seen: Seen, way: Way, r: Float, share: float, of_prior: float, cost: float, settled: float
) -> tuple[float, float, float]:
    """Move the place towards the aim, x^ + dx, as far as that costs no more, and linearise there.

    Args:
        belief: the prior.
        seen: linearised at the place.
        way: its `dx` leads to the aim.
        r: (2m,) v + H (place - x^).
        share: of the way that is tried first.
        of_prior: what the prior costs at the place.
        cost: what all costs there.
        settled: a change below this is made without looking.

    Returns:
        The largest change of an entry, 0 where nothing costs less, and both costs at the new place.
    """
    change = try_share(belief, way, share)
    if change < settled:
        way.place[: belief.size] = way.trial[: belief.size]
        return change, of_prior, cost
    across, ahead = prior_products(belief, seen, way, r)
    while share > SHORTEST:
        linearise_at(way.trial, belief, seen)
        rest = 1.0 - share
        prior_there = rest * rest * of_prior + 2.0 * share * rest * across + share * share * ahead
        cost_there = prior_there + misfit(seen)
        if cost_there <= cost + ROUNDING * (1.0 + cost):
            way.place[: belief.size] = way.trial[: belief.size]
            return change, prior_there, cost_there
        share *= 0.5
        change = try_share(belief, way, share)
    return 0.0, of_prior, cost


@kernel
def smaller_share(share: float, iteration: int, change: float, last: float) -> float:
    """Which share of its way the next pass tries: less where this one went as far as the last."""
    return max(0.5 * share, SMALLEST) if iteration >= PATIENCE and change >= last else share


@kernel
def try_share(belief: Belief, way: Way, share: float) -> float:
    """Trial <- that share of the way from the place to the aim; returns the largest change of an entry."""
    change = 0.0
    for i in range(belief.size):
        aim = belief.state[i] + way.dx[i]
        way.trial[i] = aim if share == 1.0 else way.place[i] + share * (aim - way.place[i])
        change = max(change, abs(way.trial[i] - way.place[i]))
    return change


@kernel
def linearise_at(place: Float, belief: Belief, seen: Seen) -> int:
    """Innovations and Jacobians at a place; returns the number of rows that carry information."""
    return linearise(seen.sensor, at_place(belief, place), seen.slots, seen.observation, seen.innovation, seen.jacobian)


@kernel
def misfit(seen: Seen) -> float:
    """Cost v' R^-1 v of the innovations."""
    total = 0.0
    for i in range(len(seen.slots)):
        r00, r01, r11 = noise(seen.observation_cov[i], seen.jacobian[2 * i + 1])
        total += squared_distance(seen.innovation[2 * i], seen.innovation[2 * i + 1], r00, r01, r11)
    return total


@kernel
def prior_products(belief: Belief, seen: Seen, way: Way, r: Float) -> tuple[float, float]:
    """Products l' H (place - x^) and l' H dx, with l = R^-1 (r - H dx)."""
    across, ahead = 0.0, 0.0
    for i in range(len(seen.slots)):
        h, landmark = seen.jacobian[2 * i : 2 * i + 2], 3 + 2 * seen.slots[i]
        r00, r01, r11 = noise(seen.observation_cov[i], h[1])
        gone0, gone1, moved0, moved1 = 0.0, 0.0, 0.0, 0.0
        for c in range(5):
            j = c if c < ROBOT else landmark + c - ROBOT
            gone = way.place[j] - belief.state[j]
            gone0, gone1 = gone0 + h[0, c] * gone, gone1 + h[1, c] * gone
            moved0, moved1 = moved0 + h[0, c] * way.dx[j], moved1 + h[1, c] * way.dx[j]
        e0, e1, determinant = r[2 * i] - moved0, r[2 * i + 1] - moved1, r00 * r11 - r01 * r01
        l0, l1 = (r11 * e0 - r01 * e1) / determinant, (r00 * e1 - r01 * e0) / determinant
        across, ahead = across + l0 * gone0 + l1 * gone1, ahead + l0 * moved0 + l1 * moved1
    return across, ahead
