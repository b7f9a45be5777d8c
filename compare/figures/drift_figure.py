"""Figure of relative pose errors over distances."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from slamgauge.compare.figures.figure_size import save_printed, sheet
from slamgauge.compare.figures.plot_style import LEGEND, PRINT, WRAPPED, logarithmic, styles
from slamgauge.compare.storage.safe_names import math_text

PANELS = (("translation_m", "relative translation error [m]"), ("heading_rad", "relative heading error [rad]"))


def save_drift_figure(out: Path, entries: Mapping[str, Any], title: str) -> None:
    """Write the figure `drift` into `out`; `entries` are those of metrics.json, by estimator."""
    page = sheet()
    with mpl.rc_context(PRINT):
        shape, height = ((2, 1), 4.4) if page.is_narrow else ((1, 2), 2.8)
        figure = Figure(figsize=(page.inches, height), layout="constrained")
        panels = figure.subplots(*shape, sharex=True).flat
        for axes, (key, label) in zip(panels, PANELS, strict=True):
            for name, style in styles(entries).items():
                found = [(each["distance_m"], each[key]) for each in entries[name]["rpe_by_distance"] if each[key]]
                if found:
                    axes.plot(*zip(*found, strict=True), color=style.color, linestyle=style.dashes, label=name)
            axes.set_ylabel(label)
            logarithmic(axes, "y")
        for axes in figure.axes[-shape[1] :]:
            axes.set_xlabel("length of the path segment [m]")
            logarithmic(axes, "x")
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=page.legend_columns(len(labels)), **LEGEND)
        figure.suptitle(math_text(title), **WRAPPED)
        save_printed(figure, out / "drift")
