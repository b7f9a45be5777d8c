"""Animate a run as a GIF."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.figure import Figure

from slamgauge.compare.estimators.requests import labels_among
from slamgauge.compare.figures.maps import Scene
from slamgauge.compare.figures.plot_style import DEAD_RECKONING, PRINT, legend_below
from slamgauge.compare.storage.files import explained, load_results
from slamgauge.compare.storage.progress import counted
from slamgauge.compare.storage.result_files import METRICS
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate

GIF = "animation.gif"
MOST_MAPS = 3  # more maps would hide each other
MOST_FRAMES = 600  # Pillow keeps all frames of a GIF in memory
FASTEST = 50  # frames per second; viewers of GIFs are not faster
WIDTH, DOTS = 5.0, 120  # [in], and pixels per inch
SHAPES = (0.4, 1.0)  # smallest and largest height of the map, relative to its width
EDGES = 1.1  # [in] for title, axis and legend


def animate(folder: Path, names: Sequence[str], seconds: float, fps: int) -> None:
    """Write animation.gif into a folder of results.

    Args:
        folder: Folder that `slamgauge run` or `evaluate --out` wrote.
        names: Labels or addresses of the estimates to show, with their maps. By default all filtered estimates are
            shown with their maps (only the first if there are more than three), and the paths of smoothed ones.
        seconds: Duration [s].
        fps: Frames per second, at most one frame per step.

    Raises:
        UserError: If the folder has no results or no such estimate, the duration is out of range, or slamgauge did not
            write an existing animation.
    """
    results = load_results(folder)
    shown, mapped = _chosen(results.estimates, names)
    frames = min(_frames(seconds, fps), results.recording.steps + 1)
    steps = np.linspace(0, results.recording.steps, frames).round().astype(int).tolist()
    rate: Any = frames / seconds  # typed as int by the writer, but floats work
    scene, stamps = Scene(results, shown, mapped), results.recording.stamps
    width, height = (scene.high - scene.low).tolist()
    size = (WIDTH, WIDTH * float(np.clip(height / width, *SHAPES)) + EDGES)
    with staged_folder(folder, METRICS, adds=True) as stage, mpl.rc_context(PRINT):
        figure = Figure(figsize=size, dpi=DOTS, layout="constrained")
        ax, writer = figure.subplots(), PillowWriter(rate)
        saving = writer.saving(figure, str(stage / GIF), DOTS)
        with explained(folder, "written"), counted(frames, "frame", GIF) as progress, saving:
            for before, step in pairwise([-1, *steps]):
                scene.draw(ax, step, before)
                ax.set_title(results.title, loc="left")
                ax.set_title(f"t = {stamps[step] - stamps[0]:.1f} s", loc="right")
                if before < 0:
                    legend_below(figure, ax.get_legend_handles_labels()[0])
                    figure.draw_without_rendering()
                    figure.set_layout_engine("none")  # the parts keep their places
                writer.grab_frame()
                progress.update()


def _chosen(estimates: Mapping[str, Estimate], names: Sequence[str]) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    """Return the estimates whose paths are shown, and those whose maps are shown."""
    if names:
        chosen = {name: estimates[name] for name in labels_among(names, estimates, "has no estimate in the folder")}
        return chosen, chosen
    others = {name: each for name, each in estimates.items() if name != DEAD_RECKONING} or dict(estimates)
    smoothed = {name: each for name, each in others.items() if each.kind == "smoothed"}
    filtered = [name for name in others if name not in smoothed]
    mapped = {name: others[name] for name in (filtered if len(filtered) <= MOST_MAPS else filtered[:1])}
    return mapped | smoothed, mapped or smoothed


def _frames(seconds: float, fps: int) -> int:
    if not 0 < seconds < math.inf:
        raise UserError(f"seconds {seconds}: not a duration; give a number > 0, for example 10")
    if not 1 <= fps <= FASTEST:
        raise UserError(f"fps {fps}: out of range; give 1 to {FASTEST} frames per second")
    frames = round(seconds * fps)
    if not 1 <= frames <= MOST_FRAMES:
        raise UserError(f"seconds {seconds}, fps {fps}: these are {frames} frames; give 1 to {MOST_FRAMES}")
    return frames
