"""Frames of a run: a GIF, and a strip of the moments at which the rays of an estimate begin and end (figure 4.1)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.figure import Figure, FigureBase

from slamgauge.compare.estimators.requests import labels_among
from slamgauge.compare.figures.maps import Scene, map_at
from slamgauge.compare.figures.plot_style import DEAD_RECKONING, PRINT, SHEET, legend_below, printed
from slamgauge.compare.storage.files import Results, explained, load_results
from slamgauge.compare.storage.progress import counted
from slamgauge.compare.storage.result_files import METRICS
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.display import counted as numbered
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate

GIF = "animation.gif"
MOST_MAPS = 3  # more maps would hide each other
MOST_FRAMES = 600  # Pillow keeps all frames of a GIF in memory
FASTEST = 50  # frames per second; viewers of GIFs are not faster
WIDTH, DOTS = 5.0, 120  # [in], and pixels per inch
SHAPES = (0.4, 1.0)  # smallest and largest height of the map, relative to its width
EDGES = 1.1  # [in] for title, axis and legend
FRAMES, OF_ONE_RAY = 6, 4  # all frames, and those of the ray that the titles follow
COLUMNS = {"page": 3, "column": 2}
HEADINGS, FOOT = 0.5, 0.6  # [in] above and below the panels of a row; for legend and title


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
    shown, mapped = chosen(results.estimates, names)
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


def chosen(estimates: Mapping[str, Estimate], names: Sequence[str]) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
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


def has_rays(estimate: Estimate) -> bool:
    """Return whether the estimate logged at least one ray and recorded the map."""
    log, history = estimate.rays, estimate.history
    return log is not None and history is not None and len(log.birth) > 0 and len(history.step) > 0


def ray_moments(estimate: Estimate) -> tuple[int, list[int]]:
    """Return the oldest ray that became a point, and steps at which it changes, with others up to the end of all."""
    log, history = estimate.rays, estimate.history
    assert log is not None and history is not None
    ray = np.lexsort([-log.end, log.birth, log.survivor < 0])[0]
    name, recorded = int(log.landmark[ray]), np.unique(history.step)
    members = np.array([_members(estimate, int(step), name) for step in recorded])
    chosen = _spread(recorded[np.diff(members, prepend=-1) != 0], OF_ONE_RAY)
    still_exists = log.end < 0
    last = recorded[-1] if still_exists.any() else max(log.end.max(), *chosen)
    others = np.setdiff1d(_spread(recorded[recorded <= last], FRAMES), chosen)
    return name, sorted([*chosen, *_spread(others, FRAMES - len(chosen))])


def _members(estimate: Estimate, step: int, name: int) -> int:
    """Return the number of members of a ray, 0 for a point and -1 if the landmark is not in the map."""
    rows = map_at(estimate, step)
    mine = rows.landmark == name
    return int(np.sum(rows.member[mine] >= 0)) if mine.any() else -1


def _spread(steps: np.ndarray, count: int) -> list[int]:
    """Return at most `count` of the steps, evenly spaced, with both ends."""
    places = np.linspace(0, len(steps) - 1, min(count, len(steps)))
    return steps[np.unique(places.round().astype(int))].tolist()


def caption(estimate: Estimate, step: int, name: int) -> str:
    """Return the number of rays at a step, and the state of the landmark `name`."""
    rows, members = map_at(estimate, step), _members(estimate, step, name)
    rays = numbered(len(np.unique(rows.landmark[rows.member >= 0])), "ray")
    mine = {-1: "not in the map", 0: "a point"}.get(members, numbered(members, "member"))
    return f"{rays}; landmark {name}: {mine}"


class RayStrip:
    """Frames of the rays of an estimate `name`, which has rays (`has_rays`); `height` is that of the strip [in]."""

    def __init__(self, results: Results, name: str) -> None:
        """Choose the frames."""
        self._estimate, self._stamps = results.estimates[name], results.recording.stamps
        self._ray, self._steps = ray_moments(self._estimate)
        self._columns, only = COLUMNS[SHEET.get().width], {name: self._estimate}
        self._rows = -(-len(self._steps) // self._columns)
        self._scene = Scene(results, only, only, self._steps[-1])
        width, height = (self._scene.high - self._scene.low).tolist()
        panel = SHEET.get().inches / self._columns * float(np.clip(height / width, 0.4, 1.4))
        self.height = self._rows * (panel + HEADINGS) + FOOT

    def draw(self, figure: FigureBase) -> None:
        """Draw the frames and their legend into an empty figure."""
        panels = list(figure.subplots(self._rows, self._columns, squeeze=False).flat)
        for panel, step in zip(panels, self._steps, strict=False):
            self._scene.draw(panel, step)
            title = f"t = {self._stamps[step] - self._stamps[0]:.1f} s\n{caption(self._estimate, step, self._ray)}"
            panel.set_title(title, fontsize=5 if SHEET.get().is_narrow else None)
            panel.label_outer()
            rows = map_at(self._estimate, step)
            mine = rows.only(rows.landmark == self._ray)
            for place in mine.position[np.argsort(mine.weight)][-1:]:  # the likeliest member
                panel.annotate(str(self._ray), place, (0, 5), textcoords="offset points", clip_on=True, zorder=5)
        for panel in panels[len(self._steps) :]:
            panel.set_axis_off()
        legend_below(figure, panels[0].get_legend_handles_labels()[0])


def save_ray_strip(out: Path, results: Results, name: str) -> None:
    """Write rays.png (200 dpi) and rays.svg of an estimate `name` into `out`, if it has rays."""
    strip = RayStrip(results, name)
    with printed(out / "rays", strip.height, f"{results.title}: rays of {name}") as figure:
        strip.draw(figure)
