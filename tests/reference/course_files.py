"""Files in the styles of Python translations of the Octave course; each is a right EKF with its own noise."""

from __future__ import annotations

from string import Template
from typing import NamedTuple

import numpy as np

AS_NUMBERS = "" if np.lib.NumpyVersion(np.__version__) < "2.4.0" else " with elements as numbers"  # numpy converts them

TEXT = Template("""
import math
import numpy as np

def normalize_angle(phi):
    return (phi + np.pi) % (2 * np.pi) - np.pi

def $predict(mu, sigma, u$extra):
    r1, t, r2 = $fields_of_u
    heading = $theta
    G = np.eye(len(mu))
    G[0, 2] = -t * math.sin(heading + r1)
    G[1, 2] = t * math.cos(heading + r1)
    mu[0] = mu[0] + t * math.cos(heading + r1)
    mu[1] = mu[1] + t * math.sin(heading + r1)
    mu[2] = normalize_angle(mu[2] + r1 + r2)
    R = np.zeros(sigma.shape)
    R[:3, :3] = np.diag([0.1, 0.1, 0.01])
    sigma$in_place = G @ sigma @ G.T + R
    $return_state

def $correct(mu, sigma, z, $observed):
    m = $count
    H = np.zeros((2 * m, len(mu)))
    difference = np.zeros(2 * m)
    for i in range(m):
        $fields_of_z
        at = $at
        if $is_new:
            mu[at] = mu[0] + rho * np.cos(beta + mu[2])
            mu[at + 1] = mu[1] + rho * np.sin(beta + mu[2])
            $mark
        dx, dy = $delta
        q = dx ** 2 + dy ** 2
        difference[2 * i] = rho - np.sqrt(q)
        difference[2 * i + 1] = normalize_angle(beta - np.arctan2(dy, dx) + $theta)
        H[2 * i, [0, 1, at, at + 1]] = np.array([-dx, -dy, dx, dy]) / np.sqrt(q)
        H[2 * i + 1, [0, 1, 2, at, at + 1]] = np.array([dy, -dx, -q, -dy, dx]) / q
    Q = 0.01 * np.eye(2 * m)
    K = sigma @ H.T @ np.linalg.inv(H @ sigma @ H.T + Q)
    mu$in_place_all = mu + (K @ difference)$shape
    mu[2] = normalize_angle(mu[2])
    sigma$in_place = (np.eye(len(mu)) - K @ H) @ sigma
    $return_all
""")


class Style(NamedTuple):
    """A file in one style.

    Attributes:
        source: its text.
        predict, correct: names of its functions.
        words: the convention that is found, in words.
    """

    source: str
    predict: str
    correct: str
    words: str


def _style(words: str, **parts: str) -> Style:
    defaults = {
        "predict": "prediction_step",
        "correct": "correction_step",
        "extra": "",
        "fields_of_u": "u['r1'], u['t'], u['r2']",
        "theta": "mu[2]",
        "in_place": "",
        "in_place_all": "",
        "return_state": "return mu, sigma",
        "observed": "observedLandmarks",
        "count": "len(z)",
        "fields_of_z": "j, rho, beta = z[i]['id'], z[i]['range'], z[i]['bearing']",
        "at": "2 * j + 1",
        "is_new": "not observedLandmarks[j - 1]",
        "mark": "observedLandmarks[j - 1] = True",
        "delta": "mu[at] - mu[0], mu[at + 1] - mu[1]",
        "shape": "",
        "return_all": "return mu, sigma, observedLandmarks",
    }
    filled = {**defaults, **parts}
    return Style(TEXT.substitute(filled), filled["predict"], filled["correct"], words)


FROM_0 = {"at": "3 + 2 * j", "is_new": "observedLandmarks[j] == False", "mark": "observedLandmarks[j] = True"}
COLUMN = {
    "theta": "float(mu[2])",
    "delta": "float(mu[at] - mu[0]), float(mu[at + 1] - mu[1])",
    "shape": ".reshape(-1, 1)",
}
STYLES = {
    "dicts from 1": _style("mu (2N+3,), ids from 1, z as a list of observations, observed as an array of bools"),
    "dicts from 0": _style(
        "mu (2N+3,), ids from 0, z as a list of observations, observed as an array of bools",
        predict="prediction",
        correct="correction",
        **FROM_0,
    ),
    "objects, list of bools": _style(
        "mu (2N+3,), ids from 1, z as a list of observations, observed as a list of bools",
        predict="predictionStep",
        correct="correctionStep",
        fields_of_u="u.r1, u.t, u.r2",
        fields_of_z="j, rho, beta = z[i].id, z[i].range, z[i].bearing",
        is_new="observedLandmarks[j - 1] is False",
    ),
    "column": _style(
        f"mu (2N+3, 1){AS_NUMBERS}, ids from 0, z as a list of observations, observed as an array of bools",
        predict="predict",
        correct="correct",
        **{**FROM_0, **COLUMN},
    ),
    "rows, N+1 bools": _style(
        "mu (2N+3,), ids from 1, z as a list of observations, observed as an array of N+1 bools",
        predict="predict_step",
        correct="correct_step",
        fields_of_u="u[0], u[1], u[2]",
        count="z.shape[0]",
        fields_of_z="j, rho, beta = int(z[i, 0]), z[i, 1], z[i, 2]",
        is_new="observedLandmarks[j] == 0",
        mark="observedLandmarks[j] = 1",
    ),
    "list of ids, in place": _style(
        "mu (2N+3,), ids from 0, z as a list of observations, observed as a list of ids",
        fields_of_u="u",
        in_place="[:]",
        in_place_all="[:]",
        return_state="return mu, sigma",
        observed="seen",
        fields_of_z="j, rho, beta = z[i]",
        at="3 + 2 * j",
        is_new="j not in seen",
        mark="seen.append(j)",
        return_all="return None",
    ),
    "columns of z, column of u": _style(
        "mu (2N+3,), ids from 1, z (3, m) as an array, observed as an array (1, N) of bools, u (3, 1)",
        extra=", N",
        fields_of_u="u[0, 0], u[1, 0], u[2, 0]",
        count="z.T.shape[0]",
        fields_of_z="j, rho, beta = int(z[0, i]), z[1, i], z[2, i]",
        is_new="not observedLandmarks[0, j - 1]",
        mark="observedLandmarks[0, j - 1] = True",
    ),
    "fields of all, numbers of landmarks": _style(
        "mu (2N+3,), ids from 1, z as a list of observations, observed as an array of bools",
        extra=", isFirst",
        count="len(z['id'])",
        fields_of_z="j, rho, beta = z['id'][i], z['range'][i], z['bearing'][i]",
    ),
}

# seeded bugs: the line of the right file, the wrong one, and the check that fails
BUGS = {
    "Jacobian of the motion forgotten": ("G @ sigma @ G.T + R", "sigma + R", "prediction-jacobian"),
    "bearing not normalised": (
        "difference[2 * i + 1] = normalize_angle(",
        "difference[2 * i + 1] = (",
        "innovation-wrap",
    ),
    "wrong sign of the heading in H": ("dy, -dx, -q, -dy, dx", "dy, -dx, q, -dy, dx", "update-bearing"),
}


def with_bug(style: Style, bug: str) -> str:
    """Return the source of a style with a seeded bug."""
    right, wrong, _ = BUGS[bug]
    if style.source.count(right) != 1:
        raise ValueError(f"{right!r} must occur once")
    return style.source.replace(right, wrong)
