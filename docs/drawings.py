"""Pictures of the manual that no command draws: `make_figures.py` calls the function of a `<!-- drawn NAME -->`."""

from __future__ import annotations

import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from slamgauge import compose, load_scenario, simulate

ROOT = Path(__file__).parents[1]
WORLDS = (
    ("q1-short-dense", "q1-long-dense", "q1-long-sparse", "q4-ring", "q4-three-landmarks"),
    ("tp4-handout", "freiburg-course", "huang-2010", "ukfm-slam2d", "bailey-2006"),
)
ESTIMATE, OTHER = "#0072B2", "#D55E00"


def worlds() -> Figure:
    """Draw paths and landmarks of shipped scenarios, in metres; a dot is the start."""
    figure, panels = plt.subplots(2, len(WORLDS[0]), figsize=(7.0, 3.2))
    for axes, name in zip(panels.flat, np.ravel(WORLDS), strict=True):
        truth, _ = simulate(load_scenario(name, ["start=mean"]), seed=0)
        x, y, _ = truth.poses.T
        axes.plot(x, y, color=ESTIMATE)
        axes.plot(x[0], y[0], "o", color="black")
        axes.plot(*truth.landmarks.T, "+", color="black", markersize=4)
        axes.set_title(name)
        axes.set_aspect("equal", "datalim")
    return figure


def wrong_jacobian() -> Figure:
    """Draw 95 % ellipses that the right and the wrong example predict, with 2000 sampled paths, after 8 m of an arc."""
    speed, yaw_rate, steps, prior_cov = 1.0, 0.15, 80, np.diag([1e-6, 1e-6, 0.1**2])
    figure, axes = plt.subplots(figsize=(3.4, 2.6))
    files = {"right A": "student_ekf", "wrong sign of A[0, 2]": "student_ekf_wrong_jacobian"}
    for (label, name), colour, style in zip(files.items(), (ESTIMATE, OTHER), ("-", "--"), strict=True):
        example = runpy.run_path(str(ROOT / f"examples/{name}.py"))
        x, P = np.zeros((3, 1)), prior_cov
        path = [x[:2, 0].copy()]
        for _ in range(steps):
            x, P = example["predict"](x, P, np.array([[speed], [yaw_rate]]))
            path.append(x[:2, 0].copy())
        turn = np.linspace(0, 2 * np.pi, 100)
        circle = np.sqrt(5.991) * np.array([np.cos(turn), np.sin(turn)])  # 95 % of chi-square with 2 degrees of freedom
        axes.plot(*(x[:2] + np.linalg.cholesky(P[:2, :2]) @ circle), style, color=colour, label=label, zorder=3)
    axes.plot(*np.transpose(path), color="black", label="predicted path")
    rng = np.random.default_rng(0)
    ends = rng.multivariate_normal(np.zeros(3), prior_cov, size=2000)
    sigmas = np.sqrt(np.diag(example["Q"]))
    for _ in range(steps):
        ways, turns = example["DT"] * ([speed, yaw_rate] + sigmas * rng.standard_normal((2000, 2))).T
        ends = np.array([compose(pose, [way, 0.0, angle]) for pose, way, angle in zip(ends, ways, turns, strict=True)])
    axes.plot(*ends.T[:2], ".", color="0.6", markersize=1.5, zorder=0, label="sampled ends")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.legend(loc="upper left")
    return figure
