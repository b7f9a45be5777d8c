"""Figures of the exercise: map and errors of each setting like the handout's, NEES over time, loop closures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from slamgauge.compare.exercise.results import Closure, SettingResult
from slamgauge.compare.exercise.settings import CAUSAL, EKF, GTSAM
from slamgauge.compare.figures.axes import logarithmic
from slamgauge.compare.figures.plot_style import LEGEND, MARK_COLOR, Sheet, Style, printed, printed_on, styles
from slamgauge.compare.figures.ray_frames import has_rays
from slamgauge.compare.figures.ray_strip import RayStrip
from slamgauge.compare.figures.run_figures import HEIGHTS, draw_map_and_errors
from slamgauge.compare.scoring.aggregation import BAND_LEVEL, nees_per_step
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

PNG = Sheet(formats=("png",))
PANEL_HEIGHT, FOOT = 2.2, 0.9  # [in] of a row of panels, and of title and legend
BEFORE, AFTER = 0.35, 0.85  # opacities of the bars before and at a loop closure
BAR = 0.15  # width of a bar; a lap has the width 1
PLACES = {EKF: -0.25, CAUSAL: 0.1, GTSAM: 0.35}  # of an estimator in a lap


def save_setting_figure(
    path: Path, truth: Truth, recording: Recording, estimates: Mapping[str, Estimate], title: str
) -> None:
    """Write a figure as PNG: map with truth, errors in their 3-sigma bounds, and rays of the EKF if it has any."""
    height = HEIGHTS["page"]
    with printed_on(PNG):
        if not has_rays(estimates[EKF]):
            with printed(path, height, title) as figure:
                draw_map_and_errors(figure, truth, recording, estimates, EKF)
            return
        strip = RayStrip(truth, recording, EKF, estimates[EKF])
        with printed(path, height + strip.height, title) as figure:
            parts = figure.subfigures(2, 1, height_ratios=(height, strip.height))
            above, below = cast("Iterable[SubFigure]", parts)
            draw_map_and_errors(above, truth, recording, estimates, EKF)
            strip.draw(below)


def save_nees_figure(path: Path, settings: Sequence[SettingResult], title: str) -> None:
    """Write the mean pose NEES over 3 of EKF and causal optimum against time as PNG, a panel for each setting."""
    with printed_on(PNG), printed(path, _height(len(settings)), title) as figure:
        for axes, ran in zip(_panels(figure, len(settings)), settings, strict=True):
            time = ran.scenario.trajectory.step * np.arange(ran.runs[EKF].series["nees_pose"].shape[1])
            low, high = nees_per_step(ran.runs[EKF])[1:]
            band = {"color": MARK_COLOR, "alpha": 0.25, "linewidth": 0, "label": f"{BAND_LEVEL:.1%} band"}
            axes.fill_between(time, low / 3, high / 3, **band)
            for name, style in styles((EKF, CAUSAL)).items():
                nees = nees_per_step(ran.runs[name]).value / 3
                axes.plot(time, nees, color=style.color, linestyle=style.dashes, linewidth=0.9, label=name)
            axes.set(title=_title(ran.setting.figure, ran.setting.title), xlabel="time [s]")
            logarithmic(axes, "y")
        figure.supylabel("mean pose NEES / 3 (1 when consistent)", fontsize=7.5)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, **LEGEND)


def save_closure_figure(path: Path, settings: Sequence[SettingResult], title: str) -> None:
    """Write errors and 3-sigma bounds just before and at the first loop closure of each lap as PNG.

    Settings without a loop closure have no panel; nothing is written if no setting has one.
    """
    closed = [each for each in settings if each.closures]
    if not closed:
        return
    chosen = styles((EKF, CAUSAL, GTSAM))
    with printed_on(PNG), printed(path, _height(len(closed)), title) as figure:
        for axes, each in zip(_panels(figure, len(closed)), closed, strict=True):
            for closure in each.closures:
                _draw_closure(axes, closure, chosen)
            axes.set(title=_title(each.setting.figure, each.setting.title), ylim=(0.0, None))
            laps = [closure.lap for closure in each.closures]
            axes.set_xticks(laps, [f"lap {closure.lap}\n{closure.time_s:.0f} s" for closure in each.closures])
            axes.set_xlim(min(laps) - 0.5, max(laps) + 0.5)
        figure.supylabel("position [m]", fontsize=7.5)
        figure.legend(handles=_closure_keys(chosen), loc="outside lower center", ncols=4, **LEGEND)


def _draw_closure(axes: Axes, closure: Closure, chosen: Mapping[str, Style]) -> None:
    """Draw bars of 3 sigma before and at the closure, with dots at the errors; of GTSAM batch the error only."""
    for name in (EKF, CAUSAL):
        found, color, center = closure.estimators[name], chosen[name].color, closure.lap + PLACES[name]
        pairs = ((found.three_sigma_before_m, found.error_before_m), (found.three_sigma_after_m, found.error_after_m))
        for (bound, error), side, opacity in zip(pairs, (-0.5, 0.5), (BEFORE, AFTER), strict=True):
            place = center + side * BAR
            axes.bar(place, bound or np.nan, 0.9 * BAR, color=color, alpha=opacity, edgecolor=color, linewidth=0.6)
            axes.plot(place, np.nan if error is None else error, **_dot(color))
    error = closure.estimators[GTSAM].error_after_m
    axes.plot(closure.lap + PLACES[GTSAM], np.nan if error is None else error, **_dot(chosen[GTSAM].color, "D"))


def _dot(color: str, marker: str = "o") -> dict[str, Any]:
    return {"marker": marker, "markersize": 4.5, "color": "w", "markeredgecolor": color, "markeredgewidth": 1.2}


def _closure_keys(chosen: Mapping[str, Style]) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    bars = [
        Patch(facecolor=chosen[name].color, alpha=opacity, label=f"3σ of {name} {when}")
        for name in (EKF, CAUSAL)
        for when, opacity in (("before", BEFORE), ("at the closure", AFTER))
    ]
    dots = [
        Line2D([], [], linestyle="none", label=f"RMS error of {name}", **_dot(chosen[name].color, marker))
        for name, marker in ((EKF, "o"), (CAUSAL, "o"), (GTSAM, "D"))
    ]
    return [*bars, *dots]


def _shape(panels: int) -> tuple[int, int]:
    """Return rows and columns of panels."""
    columns = panels if panels < 4 else 2 if panels == 4 else 3
    return -(-panels // columns), columns


def _height(panels: int) -> float:
    return _shape(panels)[0] * PANEL_HEIGHT + FOOT


def _panels(figure: Figure, count: int) -> list[Axes]:
    grid = list(figure.subplots(*_shape(count), squeeze=False).flat)
    for axes in grid[count:]:
        axes.set_axis_off()
    return grid[:count]


def _title(figure: str, title: str) -> str:
    return f"{figure}: {title}"
