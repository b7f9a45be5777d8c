"""Figures of an error budget, a sweep, noise, a bench, and the consistency test without ground truth."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import BOUNDS, CAUSAL, REGISTRY, is_optimum
from slamgauge.compare.estimators.requests import labels_among
from slamgauge.compare.figures.curves import band, curve, logarithmic
from slamgauge.compare.figures.plot_style import MARK_COLOR, SHEET, TRUTH_COLOR, Style, legend_below, printed, styles
from slamgauge.compare.noise.tables import verdict as verdict_on_noise
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.optimum_notes import MARK, at_places
from slamgauge.compare.storage.files import of_this_version, read_json
from slamgauge.compare.storage.result_files import BENCH, NOISE
from slamgauge.compare.studies.budget import ErrorBudget, notes, verdict
from slamgauge.compare.studies.sweep import Sweep, shares_in_doubt

BASE, COST, GAIN = "#777777", "#CC3311", "#009988"
LABEL = 15  # characters of a line under a bar
SWEPT = (
    ("ate_m", "ATE [m]"),
    ("nees_pose_per_dof", "pose NEES / 3 (1 when consistent)"),
    ("position_sigma_m", "reported position sigma [m]"),
    ("landmarks_mapped", "landmarks mapped"),
)
WIDE = 4.0  # values that span more than this factor get a logarithmic axis
ASSUMED, FOUND = "#EE7733", "#0077BB"
# noise, key of noise.json for values with this noise, color and filling of their marks
LOOKS = (("assumed", "before", ASSUMED, "none"), ("found", "after", FOUND, "full"))
NO_RESULTS = "has no results in the folder"
SHOWN = 20.0  # largest ratio of estimated and assumed sigma on the axis


def save_budget_figure(out: Path, budget: ErrorBudget) -> None:
    """Write the figure `budget`, a waterfall in which each bar starts at the end of the previous one."""
    narrow = SHEET.get().is_narrow
    lines = [verdict(budget).replace("; ", ";\n", 1), *notes(budget)]
    number: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "fontsize": 5.5 if narrow else 7.5}
    with printed(out / "budget", 3.4, "\n".join(lines)) as figure:
        axes = figure.subplots()
        before = 0.0
        for place, rung in enumerate(budget.rungs):
            increment = rung.increment_m2
            added, low, high = increment.mean, increment.low, increment.high
            if place == 0:
                color, hatch = BASE, ""
            elif added >= 0:
                color, hatch = COST, "///"
            else:
                color, hatch = GAIN, "..."
            axes.bar(place, added, bottom=before, width=0.6, color=color, hatch=hatch, edgecolor="white", linewidth=0)
            if low is not None and high is not None:
                axes.plot([place, place], [before + low, before + high], color=TRUTH_COLOR, linewidth=1)
            top = max(before, before + added, before + (high or 0.0))
            mark = MARK if rung.in_doubt else ""
            axes.annotate(f"{added:+.4f}{mark}", (place, top), (0, 3), **number)
            before = rung.mse_m2
            axes.plot([place - 0.3, place + 1.3], [before, before], ":", color=TRUTH_COLOR, linewidth=0.5)
        last = len(budget.rungs)
        axes.bar(last, before, width=0.6, color=TRUTH_COLOR)
        axes.annotate(f"{before:.4f}", (last, before), (0, 3), **number)
        base, *causes = [rung.name for rung in budget.rungs]
        names = [base, *(f"+ {cause}" for cause in causes)]
        labels = [*(textwrap.fill(name, LABEL) for name in names), f"= {budget.filter}"]
        axes.set_xticks(range(last + 1), labels, rotation=90 if narrow else 0)
        axes.margins(y=0.12)
        axes.set(ylabel="mean squared position error [m²]", ylim=(0.0, None))


def save_sweep_figure(out: Path, sweep: Sweep) -> None:
    """Write the figure `sweep`: error, consistency, reported sigma and map size against the value of the key."""
    rows, columns, height = (4, 1, 8.0) if SHEET.get().is_narrow else (2, 2, 5.0)
    title = f"{sweep.scenario}, {sweep.runs} runs at each value (bars: 95 % intervals)"
    title = "\n".join([title, *at_places(CAUSAL, shares_in_doubt(sweep), then="")])
    try:
        places = np.array([float(value) for value in sweep.values])
    except ValueError:
        places = np.arange(len(sweep.values), dtype=np.float64)
    with printed(out / "sweep", height, title) as figure:
        panels = figure.subplots(rows, columns, sharex=True).flat
        for axes, (key, label) in zip(panels, SWEPT, strict=True):
            means: list[Float] = []
            for name, style in styles(sweep.summaries[0].estimators).items():
                intervals = [summary.estimators[name][key] for summary in sweep.summaries]
                means.append(_draw_intervals(axes, places, intervals, name, style))
            every = np.concatenate(means)
            if _is_wide(every):
                axes.set_yscale("log", nonpositive="clip")
                axes.set_ylim(every.min() / 2, None)
                logarithmic(axes, "y")
            axes.set_ylabel(label)
            if key == "nees_pose_per_dof":
                axes.axhline(1.0, color=MARK_COLOR, linewidth=0.6)
        if _is_wide(places):
            axes.set_xscale("log")
        axes.set_xticks(places, sweep.values)
        axes.minorticks_off()
        for axes in figure.axes[-columns:]:
            axes.set_xlabel(sweep.key)
        legend_below(figure, figure.axes[0].get_legend_handles_labels()[0])


def _draw_intervals(axes: Axes, places: Float, intervals: list[Interval | None], name: str, style: Style) -> Float:
    """Draw means with their intervals, of optima and bounds as lines without markers; return the means."""
    ends = [(each.mean, each.low, each.high) if each else (None, None, None) for each in intervals]
    mean, low, high = np.array(ends, dtype=np.float64).T
    if is_optimum(name) or name in BOUNDS:
        style = Style(TRUTH_COLOR, style.dashes)
        label = REGISTRY[name].title if is_optimum(name) else name
        curve(axes, places, mean, style, label)
    else:
        curve(axes, places, mean, style, name, marker="o", markersize=2.5)
    axes.vlines(places, low, high, color=style.color, linewidth=0.9)
    return mean[~np.isnan(mean)]


def _is_wide(values: Float) -> bool:
    return bool(values.size and values.min() > 0 and values.max() > WIDE * values.min())


def save_noise_figure(out: Path, folder: Path) -> None:
    """Write the figure `noise` of the results in a folder: sigmas, and NIS by landmark."""
    rows, columns, height = (2, 1, 4.6) if SHEET.get().is_narrow else (1, 2, 2.9)
    with of_this_version(folder / NOISE), printed(out / "noise", height) as figure:
        content = read_json(folder / NOISE)
        sigmas, nis = figure.subplots(rows, columns).flat
        _draw_sigmas(sigmas, content["parameters"])
        _draw_nis(nis, content["nis_by_landmark"])
        legend_below(figure, nis.get_legend_handles_labels()[0])


def _draw_sigmas(axes: Axes, parameters: dict[str, Any]) -> None:
    """Draw each estimated sigma with its 95 % interval, divided by the assumed sigma.

    If the assumed sigma is 0, the divisor is the upper end of the interval, or the estimate without that end.
    """
    for place, content in enumerate(parameters.values()):
        found = Interval(content["sigma"], content["low"], content["high"])
        assumed = content["assumed"]
        over = assumed or found.high or found.mean
        low = max((found.low or 0.0) / over, 1 / SHOWN)
        high = SHOWN if found.high is None else min(found.high / over, SHOWN)
        axes.plot([low, high], [place, place], color=FOUND, linewidth=1.5)
        if found.low:
            axes.plot(found.mean / over, place, "o", color=FOUND, markersize=4)
            text = f"{found.mean:.3g}: {verdict_on_noise(found, assumed)}"
        else:
            text = verdict_on_noise(found, 0.0)
        axes.text(0.03, place - 0.2, text, transform=axes.get_yaxis_transform(), fontsize=6)
    axes.axvline(1.0, color=ASSUMED, linewidth=0.8, linestyle="--")
    axes.set_yticks(range(len(parameters)), [*parameters])
    axes.set_ylim(len(parameters) - 0.5, -0.7)
    axes.set(xscale="log", xlabel="sigma found / assumed, 95 % interval", title="noise")
    left, right = np.clip(axes.get_xlim(), 1 / SHOWN, SHOWN)
    axes.set_xlim(min(left, 0.5), max(right, 2.0))
    logarithmic(axes, "x")
    axes.grid(visible=True, axis="x", which="major", linewidth=0.3)


def _draw_nis(axes: Axes, nis_by_landmark: dict[str, Any]) -> None:
    """Draw the mean NIS per row of each landmark, in the order of ids, and its 95 % band."""
    for (channel, rows), marker in zip(nis_by_landmark.items(), ("o", "^"), strict=False):
        for noise, key, color, filling in LOOKS:
            values = _floats([row[key] for row in rows.values()])
            label = f"{channel}, {noise}"
            axes.plot(values, label=label, color=color, fillstyle=filling, marker=marker, linestyle="none")
    first = next(iter(nis_by_landmark.values())).values()
    low = _floats([row["low"] for row in first])
    high = _floats([row["high"] for row in first])
    band(axes, range(len(low)), low, high, "95 % band")
    axes.axhline(1.0, color=TRUTH_COLOR, linewidth=0.5)
    axes.set(xlabel="landmarks in the order of ids", ylabel="NIS per row", title="by landmark")
    logarithmic(axes, "y")
    axes.set_xticks([])


def save_bench_figure(out: Path, folder: Path, names: Sequence[str]) -> None:
    """Write the figure `bench` of the results in a folder: step times and their 95 % quantiles against map size.

    Step times are medians, or the mean over a run for estimators without steps. Without `names` all are drawn.
    """
    with of_this_version(folder / BENCH), printed(out / "bench", 3.4) as figure:
        axes = figure.subplots()
        measured = read_json(folder / BENCH)["estimators"]
        chosen = labels_among(names or [*measured], measured, NO_RESULTS)
        every: set[int] = set()
        for name, style in styles(chosen).items():
            sizes = [int(size) for size in measured[name]]
            every.update(sizes)
            times = measured[name].values()
            steps = 1e3 * np.array([each.get("median_s") or each["mean_s"] for each in times])
            high = 1e3 * np.array([each.get("p95_s", np.nan) for each in times])
            curve(axes, sizes, steps, style, name, marker="o")
            axes.plot(sizes, high, color=style.color, linestyle="none", marker="_", markersize=6)
        axes.set(xscale="log", yscale="log", xlabel="landmarks", ylabel="ms per step (dash: 95 %)")
        ticks = sorted(every)
        axes.set_xticks(ticks, [str(size) for size in ticks], minor=False)
        axes.minorticks_off()
        logarithmic(axes, "y")
        axes.grid(visible=True, linewidth=0.3)
        legend_below(figure, axes.get_legend_handles_labels()[0])


def save_consistency_figure(out: Path, entries: Mapping[str, Any], title: str) -> None:
    """Write the figure `consistency`: the expected NEES over time, and the band of simulated twins.

    `entries` are those of `without_truth` in metrics.json, by filter.
    """
    from slamgauge.compare.scoring.without_truth import BAND  # loads the optima

    with printed(out / "consistency", 3.0, title) as figure:
        axes = figure.subplots()
        first = next(iter(entries.values()))
        low, high = _floats(first["twins_low"]), _floats(first["twins_high"])
        band(axes, first["time_s"], low, high, f"{BAND:.0%} of twins")
        axes.axhline(1.0, color=TRUTH_COLOR, linewidth=0.6, linestyle=":")
        for name, style in styles(entries).items():
            entry = entries[name]
            curve(axes, entry["time_s"], _floats(entry["expected_nees_per_dof"]), style, name)
        logarithmic(axes, "y")
        axes.set(xlabel="time [s]", ylabel="expected NEES / 3")
        legend_below(figure, axes.get_legend_handles_labels()[0])


def _floats(values: list[float | None]) -> Float:
    """Return the values of JSON, NaN for None."""
    return np.array(values, dtype=np.float64)
