"""Table and sentences about the noise of a recording.

A sigma is as assumed if its interval contains the assumed one. A landmark is named if its NIS is outside the two-sided
chi-square band that contains all landmarks with a probability of 95 % if the noise is right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from slamgauge.compare.noise.autocorrelation import NEGLIGIBLE
from slamgauge.compare.noise.diagnosis import LEVEL, Nis
from slamgauge.compare.noise.estimation import Noise
from slamgauge.compare.noise.likelihood import Interval
from slamgauge.compare.noise.parameters import UNITS
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.table import Head, Table
from slamgauge.compare.scoring.text_page import Page

MANY = 5  # largest number of named landmarks
SIGNIFICANT = "significant"
HEADINGS = ("noise", "found", "95 % interval", "verdict", "assumed")


def noise_table(noise: Noise) -> Page:
    """Return the table and the sentences below it."""
    rows: list[tuple[str, ...]] = []
    for name, found in noise.parameters.items():
        assumed = noise.assumed[name]
        cells = (_figure(found.value), _interval(found), verdict(found, assumed), _figure(assumed))
        rows.append((f"{name} [{UNITS[name]}]", *cells))
    for name, found in noise.systematic.items():
        cells = (f"{found.value:+.3g}", _interval(found), systematic_verdict(found), "0")
        rows.append((f"{name} [{UNITS[name]}]", *cells))
    heads = [Head(title, words=True, wraps=title == "verdict") for title in HEADINGS]
    return Page((Table.of(heads, rows), *lines(noise)))


def lines(noise: Noise) -> list[str]:
    """Return the sentences below the table."""
    parts = (_outliers, _heading, _nis, _landmarks, _correlation, _gain)
    return [line for part in parts for line in part(noise)]


def _figure(value: float) -> str:
    return f"{value:.4g}"


def _interval(found: Interval) -> str:
    if found.low == 0.0 and math.isinf(found.high):
        return "not determined by the log"
    if math.isinf(found.high):
        return f"above {_figure(found.low)}"
    return f"{_figure(found.low)} to {_figure(found.high)}"


def verdict(found: Interval, assumed: float) -> str:
    """Return a comparison of the assumed sigma with the interval."""
    fits = found.low <= assumed <= found.high
    if found.low == 0.0 and math.isinf(found.high):
        return "any value fits"
    if found.low == 0.0:
        return f"any value below {_figure(found.high)} fits" + ("" if fits else ": the assumed one is too large")
    if fits:
        return "as assumed"
    if assumed == 0.0:
        return "noise found, but none assumed"
    factor = assumed / found.value
    return f"assumed {factor:.2f} times too large" if factor > 1 else f"assumed {1 / factor:.2f} times too small"


def systematic_verdict(found: Interval) -> str:
    """Return whether a systematic error is significant: its interval does not contain 0."""
    return "not significant" if found.low <= 0.0 <= found.high else SIGNIFICANT


def _outliers(noise: Noise) -> Iterator[str]:
    for channel, rate in noise.rates.items():
        spread, unit = noise.values[f"{channel} spread"], UNITS[channel]
        yield (
            f"outliers: {rate.value:.2%} of the {channel} errors (95 % interval {rate.low:.2%} to {rate.high:.2%}), "
            f"with a standard deviation of {spread:.3g} {unit}; the sigma in the table is that of the other errors"
        )
    for name, dof in noise.values.items():
        if name.endswith(" dof"):
            channel = name.removesuffix(" dof")
            yield (
                f"heavy tails: {channel} errors follow Student's t distribution with {dof:.3g} degrees of freedom; the "
                "sigma in the table is its scale"
            )
    if noise.first_sights_left_out:
        yield f"first observations excluded, because the next ones contradict them: {noise.first_sights_left_out}"
    if noise.left_without_id:
        yield f"observations excluded, because they fit no landmark: {noise.left_without_id}"


def _heading(noise: Noise) -> Iterator[str]:
    offset = noise.systematic.get("bearing_offset")
    if offset is not None and systematic_verdict(offset) == SIGNIFICANT and not noise.keeps_assumed:
        other = "odometry" if noise.heading == "sensor" else "sensor"
        rotated = "odometry is" if noise.heading == "sensor" else "bearings are"
        yield (
            f"the forward directions of sensor and odometry differ by {offset.value:+.3g} rad, and the log does not "
            f"determine which of them headings refer to; here it is the {noise.heading}'s, and {rotated} rotated "
            f"(--heading {other} chooses the {other}'s)"
        )


def _nis(noise: Noise) -> Iterator[str]:
    for channel, after in noise.after.nis.items():
        yield (
            f"NIS of {channel} (mean squared normalised innovation, 1 if the noise is right): "
            f"{noise.before.nis[channel].mean:.3f} with the assumed noise, {after.mean:.3f} with the noise found "
            f"(95 % band {after.low:.3f} to {after.high:.3f}, {after.rows} innovations)"
        )


def _landmarks(noise: Noise) -> Iterator[str]:
    for channel, by_landmark in noise.after.nis_by_landmark.items():
        outside = {each: nis for each, nis in by_landmark.items() if _is_outside(nis, len(by_landmark))}
        worst = sorted(outside, key=lambda each: -abs(math.log(max(outside[each].mean, 1e-9))))[:MANY]
        if worst:
            named = ", ".join(f"{each} (NIS {outside[each].mean:.2f})" for each in worst)
            share = f"{len(outside)} of {len(by_landmark)}"
            yield f"{channel} noise differs between landmarks: NIS is outside its band for {share}, most for {named}"


def _is_outside(nis: Nis, landmarks: int) -> bool:
    if not nis.rows:
        return False
    low, high = chi2_band(1.0 - (1.0 - LEVEL) / landmarks, nis.rows)
    return not low <= nis.mean * nis.rows <= high


def _correlation(noise: Noise) -> Iterator[str]:
    for channel, correlation in noise.after.correlation.items():
        first, band = float(correlation[0]), noise.after.correlation_band[channel]
        if abs(first) > max(band, NEGLIGIBLE):
            yield (
                f"{channel} errors are not white: successive errors of a landmark have a correlation of {first:+.2f} "
                f"(95 % limit for white noise {band:.2f}); the intervals assume white noise and are too narrow"
            )
    counted = noise.sights_counted_as_one
    if counted > 1.0:
        yield (
            f"errors are correlated: {counted:.2g} observations of a landmark count as one within the memory of the "
            "filter; --write multiplies the covariances of observations by this number"
        )


def _gain(noise: Noise) -> Iterator[str]:
    yield f"log-likelihood of the noise found: {noise.log_likelihood_gain:+z.1f} nats relative to the assumed noise"
    if noise.held_out is None:
        yield "held-out test: not possible, because one half of the log does not determine the noise"
    else:
        gain, count = noise.held_out
        kept = "; this is a loss, and the assumed noise is kept" if noise.keeps_assumed else ""
        yield (
            f"held-out test: the noise found in the first half of the log gains {gain:+z.1f} nats on the {count} "
            f"observations of the second half ({gain / count:+z.3f} each){kept}"
        )
