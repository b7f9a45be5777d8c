"""Figure of the consistency test without ground truth: the expected NEES over time, and the band of simulated twins."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slamgauge.compare.figures.axes import band, curve, logarithmic
from slamgauge.compare.figures.plot_style import TRUTH_COLOR, legend_below, printed, styles


def save_consistency_figure(out: Path, entries: Mapping[str, Any], title: str) -> None:
    """Write the figure `consistency` into `out`; `entries` are those of `without_truth` in metrics.json, by filter."""
    from slamgauge.compare.scoring.without_truth import BAND  # loads the optima

    with printed(out / "consistency", 3.0, title) as figure:
        axes = figure.subplots()
        first = next(iter(entries.values()))
        low, high = (np.array(first[key], dtype=np.float64) for key in ("twins_low", "twins_high"))
        band(axes, first["time_s"], low, high, f"{BAND:.0%} of twins")
        axes.axhline(1.0, color=TRUTH_COLOR, linewidth=0.6, linestyle=":")
        for name, style in styles(entries).items():
            course = np.array(entries[name]["expected_nees_per_dof"], dtype=np.float64)
            curve(axes, entries[name]["time_s"], course, style, name)
        logarithmic(axes, "y")
        axes.set(xlabel="time [s]", ylabel="expected NEES / 3")
        legend_below(figure, axes.get_legend_handles_labels()[0])
