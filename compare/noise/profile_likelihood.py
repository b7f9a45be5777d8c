"""Profile likelihood intervals.

An interval holds the values of a parameter at which twice the log-likelihood, at its best over all others, is at most
3.84 below its maximum. Its ends are found as by Venzon and Moolgavkar (Applied Statistics 37(1), 1988): step by step to
where the quadratic model at the newest point puts them.
"""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.noise.likelihood import RIDGE, Likelihood, Local

CRITICAL = 3.841  # chi-square, 1 degree of freedom, 95 %
FAR = 6.0  # from the maximum: a factor of 400, beyond which there is no end
LONGEST = 1.5  # step towards an end
STEPS = 12  # at most
CLOSE = 0.02  # share of the way to an end, of the last step


def ends(likelihood: Likelihood, best: Float, place: int) -> tuple[float, float]:
    """The 95 % interval of parameter `place` about the maximum `best` (P,); infinite where it has no end."""
    low, high = (_end(likelihood, best, place, side) for side in (-1, 1))
    return low, high


def _end(likelihood: Likelihood, best: Float, place: int, side: int) -> float:
    top, point, deviance, local = likelihood.value(best), best, 0.0, likelihood.top(best)
    for _ in range(STEPS):
        step = _step_to_end(deviance, local, place, side)
        if abs(step[place]) > LONGEST:
            step *= LONGEST / abs(step[place])
        ahead = side * (point[place] + step[place] - best[place])
        if deviance > 0.0 and abs(step[place]) < CLOSE * ahead:
            return float(point[place] + step[place])
        if ahead > FAR:
            break
        point = point + step
        deviance, local = 2.0 * (top - likelihood.value(point)), likelihood.local(point)
        if not math.isfinite(deviance):
            break
    return side * math.inf


def _step_to_end(deviance: float, local: Local, place: int, side: int) -> Float:
    """From a point of that deviance to where the quadratic model, at its best over the others, has CRITICAL.

    Its deviance is D - 2 g's + s'Hs. Best over the others, s_o = H_oo^-1 (g_o - H_oa s_a); what is left is quadratic in
    s_a, and without a root goes to its minimum.
    """
    others = np.delete(np.arange(len(local.gradient)), place)
    H = local.information + RIDGE * np.eye(len(local.gradient))
    g = local.gradient
    solved = np.linalg.solve(H[np.ix_(others, others)], np.column_stack([g[others], H[others, place]]))
    reduced = deviance - g[others] @ solved[:, 0] - CRITICAL
    slope = g[place] - H[place, others] @ solved[:, 0]
    curvature = H[place, place] - H[place, others] @ solved[:, 1]
    root = math.sqrt(max(slope**2 - curvature * reduced, 0.0))
    step = np.zeros(len(g))
    step[place] = (slope + side * root) / curvature
    step[others] = solved[:, 0] - solved[:, 1] * step[place]
    return step
