"""Figure of the error budget: a waterfall in which each bar starts at the end of the previous one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from slamgauge.compare.estimators.registry import FIXED_LAG
from slamgauge.compare.figures.plot_style import TRUTH_COLOR, printed, sheet
from slamgauge.compare.scoring.optimum_notes import MARK
from slamgauge.compare.studies.budget import ErrorBudget, notes, verdict

BASE, COST, GAIN = "#777777", "#CC3311", "#009988"
LABELS = {
    "hindsight optimum": "hindsight\noptimum",
    "causal optimum": "+ causal\nonly",
    "assumed noise": "+ assumed\nnoise",
    "own associations": "+ own asso-\nciations",
    FIXED_LAG: "+ fixed\nlag",
    "linearisation": "+ lineari-\nsation",
}


def save_budget_figure(out: Path, budget: ErrorBudget) -> None:
    """Write budget.png and budget.svg into `out`."""
    narrow, last = sheet().is_narrow, len(budget.rungs)
    lines = [verdict(budget).replace("; ", ";\n", 1), *notes(budget)]
    number: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "fontsize": 5.5 if narrow else 7.5}
    with printed(out / "budget", 3.4, "\n".join(lines)) as figure:
        axes = figure.subplots()
        before = 0.0
        for place, rung in enumerate(budget.rungs):
            added, low, high = rung.increment_m2.mean, rung.increment_m2.low, rung.increment_m2.high
            color, hatch = (BASE, "") if place == 0 else (COST, "///") if added >= 0 else (GAIN, "...")
            axes.bar(place, added, bottom=before, width=0.6, color=color, hatch=hatch, edgecolor="white", linewidth=0)
            if low is not None and high is not None:
                axes.plot([place, place], [before + low, before + high], color=TRUTH_COLOR, linewidth=1)
            top = max(before, before + added, before + (high or 0.0))
            mark = MARK if rung.in_doubt else ""
            axes.annotate(f"{added:+.4f}{mark}", (place, top), (0, 3), **number)
            axes.plot([place - 0.3, place + 1.3], [rung.mse_m2] * 2, color=TRUTH_COLOR, linewidth=0.5, linestyle=":")
            before = rung.mse_m2
        axes.bar(last, before, width=0.6, color=TRUTH_COLOR)
        axes.annotate(f"{before:.4f}", (last, before), (0, 3), **number)
        labels = [*(LABELS[rung.name] for rung in budget.rungs), f"= {budget.filter}"]
        axes.set_xticks(range(last + 1), labels, rotation=90 if narrow else 0)
        axes.margins(y=0.12)
        axes.set(ylabel="mean squared position error [m²]", ylim=(0.0, None))
