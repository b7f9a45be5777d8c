"""Figures of the exercise: map and errors of each setting like the handout's, NEES over time, loop closures."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from slamgauge.compare.exercise.results import Closure, SettingResult
from slamgauge.compare.exercise.settings import CAUSAL, EKF, GTSAM, Setting
from slamgauge.compare.figures.plot_style import (
    Sheet,
    band,
    curve,
    legend_below,
    logarithmic,
    printed,
    printed_on,
    styles,
)
from slamgauge.compare.figures.ray_strip import RayStrip, has_rays
from slamgauge.compare.figures.run_figures import HEIGHTS, draw_map_and_errors
from slamgauge.compare.scoring.runs import BAND_LEVEL
from slamgauge.compare.storage.files import Results
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

PNG = Sheet(formats=("png",))
PANEL_HEIGHT, FOOT = 2.2, 0.9  # [in] of a row of panels, and of title and legend
BEFORE, AFTER = 0.35, 0.85  # opacities of the bars before and at a loop closure
BAR = 0.15  # width of a bar; a lap has the width 1
PLACES = {EKF: -0.25, CAUSAL: 0.1, GTSAM: 0.35}  # place of an estimator in a lap


def save_setting_figure(
    path: Path, truth: Truth, recording: Recording, estimates: Mapping[str, Estimate], title: str
) -> None:
    """Write a figure as PNG: map with truth, errors in their 3-sigma bounds, and rays of the EKF if it has any."""
    height = HEIGHTS["page"]
    with printed_on(PNG):
        if not has_rays(estimates[EKF]):
            with printed(path, height, title) as figure:
                draw_map_and_errors(figure, truth, recording, estimates)
            return
        strip = RayStrip(Results(title, truth, recording, dict(estimates)), EKF)
        with printed(path, height + strip.height, title) as figure:
            parts = figure.subfigures(2, 1, height_ratios=(height, strip.height))
            above, below = cast("Iterable[SubFigure]", parts)
            draw_map_and_errors(above, truth, recording, estimates)
            strip.draw(below)


def save_nees_figure(path: Path, settings: Sequence[SettingResult], title: str) -> None:
    """Write the mean pose NEES over 3 of EKF and causal optimum against time as PNG, a panel for each setting."""
    with _panels(path, [each.setting for each in settings], title) as (figure, panels):
        for axes, ran in zip(panels, settings, strict=True):
            found = {name: ran.runs[name].nees_per_step() for name in (EKF, CAUSAL)}
            time = ran.scenario.trajectory.step * np.arange(len(found[EKF].value))
            band(axes, time, found[EKF].low / 3, found[EKF].high / 3, f"{BAND_LEVEL:.1%} band")
            for name, style in styles(found).items():
                curve(axes, time, found[name].value / 3, style, name)
            axes.set_xlabel("time [s]")
            logarithmic(axes, "y")
        figure.supylabel("mean pose NEES / 3 (1 when consistent)", fontsize=7.5)
        legend_below(figure, panels[0].get_legend_handles_labels()[0])


def save_closure_figure(path: Path, settings: Sequence[SettingResult], title: str) -> None:
    """Write errors and 3-sigma bounds just before and at the first loop closure of each lap as PNG.

    Settings without a loop closure have no panel; nothing is written if no setting has one.
    """
    closed = [each for each in settings if each.closures]
    if not closed:
        return
    with _panels(path, [each.setting for each in closed], title) as (figure, panels):
        for axes, each in zip(panels, closed, strict=True):
            for closure in each.closures:
                _draw_closure(axes, closure)
            laps = [closure.lap for closure in each.closures]
            axes.set_xticks(laps, [f"lap {closure.lap}\n{closure.time_s:.0f} s" for closure in each.closures])
            axes.set(xlim=(min(laps) - 0.5, max(laps) + 0.5), ylim=(0.0, None))
        figure.supylabel("position [m]", fontsize=7.5)
        labelled = dict(zip(*reversed(panels[0].get_legend_handles_labels()), strict=True))  # each label once
        figure.legend(handles=[*labelled.values()], loc="outside lower center", ncols=4)


def _draw_closure(axes: Axes, closure: Closure) -> None:
    """Draw bars of 3 sigma before and at the closure, with dots at the errors; of GTSAM batch the error only."""
    for name, style in styles(PLACES).items():
        found, center = closure.estimators[name], closure.lap + PLACES[name]
        dot: dict[str, Any] = {"markersize": 4.5, "color": "w", "markeredgecolor": style.color, "markeredgewidth": 1.2}
        dot |= {"marker": "D" if name == GTSAM else "o", "linestyle": "none"}
        error = np.array([found.error_before_m, found.error_after_m], dtype=np.float64)
        if name == GTSAM:
            axes.plot(center, error[1], label=f"RMS error of {name}", **dot)
            continue
        places = center + BAR * np.array([-0.5, 0.5])
        bounds = np.array([found.three_sigma_before_m, found.three_sigma_after_m], dtype=np.float64)
        moments = (("before", BEFORE), ("at the closure", AFTER))
        for place, bound, (when, opacity) in zip(places, bounds, moments, strict=True):
            axes.bar(place, bound, 0.9 * BAR, color=style.color, alpha=opacity, label=f"3σ of {name} {when}")
        axes.plot(places, error, label=f"RMS error of {name}", **dot)


@contextmanager
def _panels(path: Path, settings: Sequence[Setting], title: str) -> Generator[tuple[Figure, list[Axes]]]:
    """Yield a figure, which is written as PNG at the end, with a panel for each setting."""
    count = len(settings)
    columns = count if count < 4 else 2 if count == 4 else 3
    rows = -(-count // columns)
    with printed_on(PNG), printed(path, rows * PANEL_HEIGHT + FOOT, title) as figure:
        grid: list[Axes] = list(figure.subplots(rows, columns, squeeze=False).flat)
        for axes, setting in zip(grid, settings, strict=False):
            axes.set_title(f"{setting.figure}: {setting.title}")
        for axes in grid[count:]:
            axes.set_axis_off()
        yield figure, grid[:count]
