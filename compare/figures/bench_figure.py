"""Figure of `slamgauge bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from slamgauge.compare.bench.step_times import step_time
from slamgauge.compare.figures.axes import curve, logarithmic
from slamgauge.compare.figures.plot_style import legend_below, printed, styles


def save_bench_figure(out: Path, content: dict[str, Any]) -> None:
    """Write the figure `bench` into `out`: step times and their 95 % quantiles against map size, on logarithmic axes.

    Step times are medians, or the mean over a run for estimators without steps. `content` is that of bench.json.
    """
    with printed(out / "bench", 3.4) as figure:
        axes = figure.subplots()
        for name, style in styles(content["estimators"]).items():
            by_size = content["estimators"][name]
            sizes = np.array([int(size) for size in by_size])
            times = np.array([step_time(figures) for figures in by_size.values()]) * 1e3
            high = np.array([figures.get("p95_s", np.nan) for figures in by_size.values()]) * 1e3
            curve(axes, sizes, times, style, name, marker="o")
            axes.plot(sizes, high, color=style.color, linestyle="none", marker="_", markersize=6)
        sizes = sorted({int(size) for by_size in content["estimators"].values() for size in by_size})
        axes.set(xscale="log", yscale="log", xlabel="landmarks", ylabel="ms per step (dash: 95 %)")
        axes.set_xticks(sizes, [str(size) for size in sizes], minor=False)
        axes.minorticks_off()
        logarithmic(axes, "y")
        axes.grid(visible=True, linewidth=0.3)
        legend_below(figure, axes.get_legend_handles_labels()[0])
