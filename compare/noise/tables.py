"""Tables of noise.json, for terminal and page.

A sigma is as assumed if its interval contains the assumed one.
"""

from __future__ import annotations

from typing import Any

from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.table import Cell, Head, Page, Table, figure

SIGNIFICANT = "significant"
HEADS = (
    Head("noise", help="measurement and unit", words=True),
    Head("found", help="maximum likelihood value", words=True),
    Head("95 % interval", help="interval of the profile likelihood", words=True),
    Head("verdict", help="comparison of the interval with the assumed value", words=True, wraps=True),
    Head("assumed", help="value in the recording", words=True),
)


def noise_page(content: dict[str, Any]) -> Page:
    """Return the table and the notes of noise.json."""
    return Page((noise_table(content), *content["notes"]))


def noise_table(content: dict[str, Any]) -> Table:
    """Return sigmas and systematic errors with intervals and verdicts."""
    rows: list[list[Cell | str]] = []
    for name, each in content["parameters"].items():
        found, assumed = Interval(each["sigma"], each["low"], each["high"]), each["assumed"]
        cells = (figure(found.mean, "{:.4g}"), _ends(found), verdict(found, assumed), figure(assumed, "{:.4g}"))
        rows.append([f"{name} [{each['unit']}]", *cells])
    for name, each in content["systematic"].items():
        found = Interval(each["value"], each["low"], each["high"])
        cells = (figure(found.mean, "{:+.3g}"), _ends(found), systematic_verdict(found), "0")
        rows.append([f"{name} [{each['unit']}]", *cells])
    return Table.of(HEADS, rows, "Sigmas found and assumed, with 95 % intervals", "noise")


def _ends(found: Interval) -> str:
    if found.high is None:
        return f"above {found.low:.4g}" if found.low else "not determined by the log"
    return f"below {found.high:.4g}" if found.low is None else f"{found.low:.4g} to {found.high:.4g}"


def verdict(found: Interval, assumed: float) -> str:
    """Return a comparison of the assumed sigma with the interval."""
    low, high = found.low or 0.0, found.high
    fits = low <= assumed and (high is None or assumed <= high)
    if not low:
        too_large = "" if fits else ": the assumed one is too large"
        return "any value fits" if high is None else f"any value below {high:.4g} fits{too_large}"
    if fits:
        return "as assumed"
    if assumed == 0.0:
        return "noise found, but none assumed"
    factor = assumed / found.mean
    return f"assumed {factor:.2f} times too large" if factor > 1 else f"assumed {1 / factor:.2f} times too small"


def systematic_verdict(found: Interval) -> str:
    """Return whether a systematic error is significant: its interval does not contain 0."""
    return SIGNIFICANT if found.is_above(0.0) or found.is_below(0.0) else "not significant"
