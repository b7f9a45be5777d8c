"""Reduction of a scan to three rows with all its information about its pose, compiled.

An orthogonal transformation of the rows [Hx, Hm of each observed landmark, residual] makes Hx zero from the fourth row
on. Those rows are added to the landmarks' information and right-hand side; the caller processes the first three.
There are two methods: Householder reflections subtract no information; projection needs far fewer operations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.residuals import Measured, cosine_sine, observation_residual, observation_row
from slamgauge.graph_baseline.solver.linear_problem import Linear, State
from slamgauge.graph_baseline.solver.matrices_3x3 import gram
from slamgauge.jit import inner

DEPENDENT = 1e-24  # remaining share of a squared column that counts as rounding


@inner
def scan_slots(measured: Measured, k: int) -> Int:
    """Return the slots (s,) of a scan's landmarks, without landmarks that have no slot."""
    slots, taken = np.empty(measured.first[k + 1] - measured.first[k], dtype=np.int64), 0
    for row in range(measured.first[k], measured.first[k + 1]):
        if measured.slot[row] >= 0:
            slots[taken] = measured.slot[row]
            taken += 1
    return slots[:taken]


class ScanPose(NamedTuple):
    """The pose of a scan, and the states at which its observations are evaluated."""

    k: int
    state: State  # residuals are computed here
    before: State  # residuals are extrapolated linearly to this point
    heading: tuple[float, float]  # cosine and sine of pose k's heading at `state`
    linear_heading: tuple[float, float]  # the same at the linearisation point


@inner
def linearise_observation(measured: Measured, linear: Linear, scan: ScanPose, row: int, residual: Float) -> None:
    """Write an observation's Jacobians to `linear`, and its residual (d,), extrapolated to `scan.before`."""
    k, state, before = scan.k, scan.state, scan.before
    slot, Hx, Hm = measured.slot[row], linear.Hx[row], linear.Hm[row]
    observation = observation_row(measured, row)
    at, landmark_at = linear.at.landmarks[slot], state.landmarks[slot]
    ex, ey = landmark_at[0] - state.poses[k, 0], landmark_at[1] - state.poses[k, 1]
    r0, r1, _, _, _, _ = observation_residual(measured.sensor, observation, scan.heading, ex, ey)
    ex, ey = at[0] - linear.at.poses[k, 0], at[1] - linear.at.poses[k, 1]
    _, _, a00, a01, a10, a11 = observation_residual(measured.sensor, observation, scan.linear_heading, ex, ey)
    residual[0], Hm[0, 0], Hm[0, 1] = r0, a00, a01
    if measured.value.shape[1] == 2:
        residual[1], Hm[1, 0], Hm[1, 1] = r1, a10, a11
    for i in range(measured.value.shape[1]):
        Hx[i, 0], Hx[i, 1], Hx[i, 2] = -Hm[i, 0], -Hm[i, 1], Hm[i, 0] * ey - Hm[i, 1] * ex
        for j in range(3):
            residual[i] += Hx[i, j] * (before.poses[k, j] - state.poses[k, j])
        for j in range(2):
            residual[i] += Hm[i, j] * (before.landmarks[slot, j] - state.landmarks[slot, j])


@inner
def reduce_by_reflections(measured: Measured, linear: Linear, state: State, before: State, slots: Int, k: int) -> Float:
    """Reduce a scan by Householder reflections; return its rows, with zero Hx from the fourth row on."""
    d, taken = measured.value.shape[1], len(slots)
    scan = np.zeros((max(3, d * taken), 4 + 2 * taken))
    pose = ScanPose(k, state, before, cosine_sine(state.poses[k]), cosine_sine(linear.at.poses[k]))
    residual, n = np.empty(2), 0
    for row in range(measured.first[k], measured.first[k + 1]):
        if measured.slot[row] < 0:
            continue
        linearise_observation(measured, linear, pose, row, residual)
        for i in range(d):
            of_row = scan[d * n + i]
            of_row[-1] = residual[i]
            for j in range(3):
                of_row[j] = linear.Hx[row, i, j]
            for j in range(2):
                of_row[3 + 2 * n + j] = linear.Hm[row, i, j]
        n += 1
    if d * taken > 3:
        for j in range(3):
            reflect(scan[j:], j)
    add_landmarks_alone(linear, scan, slots)
    return scan


@inner
def reduce_by_projection(measured: Measured, linear: Linear, state: State, before: State, slots: Int, k: int) -> Float:
    """Reduce a scan by projection; return the three rows Q' times the scan, with Hx = Q R.

    The information of all rows minus that of these three is added to the landmarks.
    """
    d, taken = measured.value.shape[1], len(slots)
    columns, n = np.empty((4, d * taken)), 0  # three columns of Hx, replaced by Q, and the residuals
    residual, R, scan = np.empty(2), np.zeros((3, 3)), np.zeros((3, 4 + 2 * taken))
    pose = ScanPose(k, state, before, cosine_sine(state.poses[k]), cosine_sine(linear.at.poses[k]))
    for row in range(measured.first[k], measured.first[k + 1]):
        slot = measured.slot[row]
        if slot < 0:
            continue
        linearise_observation(measured, linear, pose, row, residual)
        for i in range(d):
            columns[3, d * n + i] = residual[i]
            for j in range(3):
                columns[j, d * n + i] = linear.Hx[row, i, j]
            for j in range(2):
                linear.rhs[2 * slot + j] -= linear.Hm[row, i, j] * residual[i]
                for o in range(2):
                    linear.information[2 * slot + j, 2 * slot + o] += linear.Hm[row, i, j] * linear.Hm[row, i, o]
        n += 1
    gram_schmidt(columns[:3], R)
    n = 0
    for row in range(measured.first[k], measured.first[k + 1]):
        if measured.slot[row] < 0:
            continue
        for i in range(d):
            for j in range(3):
                q = columns[j, d * n + i]
                scan[j, -1] += q * columns[3, d * n + i]
                for o in range(2):
                    scan[j, 3 + 2 * n + o] += q * linear.Hm[row, i, o]
        n += 1
    for i in range(3):
        for j in range(3):
            scan[i, j] = R[i, j]
    subtract_scan(linear, scan, slots)
    return scan


@inner
def gram_schmidt(columns: Float, R: Float) -> None:
    """Orthonormalise columns, stored as rows (3, n), to Q and R (3, 3); a dependent column becomes zero.

    Each column is orthogonalised twice for accuracy.
    """
    for j in range(3):
        whole = np.dot(columns[j], columns[j])
        for _ in range(2):
            for i in range(j):
                along = np.dot(columns[i], columns[j])
                R[i, j] += along
                for n in range(columns.shape[1]):
                    columns[j, n] -= along * columns[i, n]
        left = np.dot(columns[j], columns[j])
        R[j, j] = math.sqrt(left) if left > DEPENDENT * whole else 0.0
        for n in range(columns.shape[1]):
            columns[j, n] = columns[j, n] / R[j, j] if R[j, j] > 0.0 else 0.0


@inner
def subtract_scan(linear: Linear, scan: Float, slots: Int) -> None:
    """Subtract the information about landmarks in the first three rows of a scan."""
    for n in range(len(slots)):
        for i in range(2):
            column = 3 + 2 * n + i
            for j in range(3):
                linear.rhs[2 * slots[n] + i] += scan[j, column] * scan[j, -1]
            for o in range(len(slots)):
                if slots[o] <= slots[n]:
                    row = linear.information[2 * slots[n] + i]
                    for j in range(3):
                        row[2 * slots[o]] -= scan[j, column] * scan[j, 3 + 2 * o]
                        row[2 * slots[o] + 1] -= scan[j, column] * scan[j, 4 + 2 * o]


@inner
def reflect(rows: Float, column: int) -> None:
    """Apply a Householder reflection that makes the column zero, except for its first entry."""
    v, along, squared = np.empty(len(rows)), np.zeros(rows.shape[1]), 0.0
    for i in range(len(rows)):
        v[i] = rows[i, column]
        squared += v[i] * v[i]
    if squared == 0.0:
        return
    v[0] += math.copysign(math.sqrt(squared), v[0])
    squared += v[0] * v[0] - rows[0, column] * rows[0, column]
    for i in range(len(rows)):
        for j in range(rows.shape[1]):
            along[j] += v[i] * rows[i, j]
    for i in range(len(rows)):
        for j in range(rows.shape[1]):
            rows[i, j] -= 2.0 * along[j] / squared * v[i]
    for i in range(1, len(rows)):
        rows[i, column] = 0.0


@inner
def add_landmarks_alone(linear: Linear, scan: Float, slots: Int) -> None:
    """Add the information in the rows of a scan from the fourth on, which depends only on landmarks."""
    alone = np.empty((len(scan) - 3, scan.shape[1] - 3))
    for i in range(alone.shape[0]):
        for j in range(alone.shape[1]):
            alone[i, j] = scan[3 + i, 3 + j]
    added = gram(alone)
    for n in range(len(slots)):
        for i in range(2):
            for o in range(len(slots)):
                for j in range(2):
                    linear.information[2 * slots[n] + i, 2 * slots[o] + j] += added[2 * n + i, 2 * o + j]
            linear.rhs[2 * slots[n] + i] -= added[2 * n + i, 2 * len(slots)]
