"""What was found of a log's noise, in a table and in sentences, by rules and nothing else.

A sigma is as assumed if the assumed one lies in its interval. A landmark is named whose NIS leaves the two-sided band
of chi-square that all landmarks of a right model keep with 95 % together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from slamgauge.compare.noise.autocorrelation import WORTH_SAYING
from slamgauge.compare.noise.diagnosis import Diagnosis, Nis
from slamgauge.compare.noise.estimation import Noise, Supported
from slamgauge.compare.noise.parameters import UNITS
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.text_page import Grid, Page

LEVEL = 0.95
MANY = 5  # landmarks that are named at most
THERE_IS = "there is one"
HEADINGS = ("noise", "found", "95 % interval", "verdict", "assumed")


def noise_table(noise: Noise) -> Page:
    """The table and the lines under it."""
    rows: list[tuple[str, ...]] = [HEADINGS]
    for name, found in noise.parameters.items():
        assumed = noise.assumed[name]
        cells = (_figure(found.value), _interval(found), verdict(found, assumed), _figure(assumed))
        rows.append((_with_unit(name), *cells))
    for name, found in noise.systematic.items():
        cells = (f"{found.value:+.3g}", _interval(found), systematic_verdict(found), "0")
        rows.append((_with_unit(name), *cells))
    return Page((Grid(rows, len(HEADINGS), sentences=HEADINGS.index("verdict")), *lines(noise)))


def _with_unit(name: str) -> str:
    return f"{name} [{UNITS[name]}]"


def lines(noise: Noise) -> list[str]:
    """The sentences under the table."""
    return [
        *_outliers(noise),
        *_heading(noise),
        *_nis(noise),
        *_landmarks(noise.after),
        *_whiteness(noise),
        *_gain(noise),
    ]


def _figure(value: float) -> str:
    return f"{value:.4g}"


def _interval(found: Supported) -> str:
    if found.low == 0.0 and math.isinf(found.high):
        return "the log does not tell"
    if math.isinf(found.high):
        return f"above {_figure(found.low)}"
    return f"{_figure(found.low)} to {_figure(found.high)}"


def verdict(found: Supported, assumed: float) -> str:
    """How the assumed sigma stands to its interval."""
    fits = found.low <= assumed <= found.high
    if found.low == 0.0 and math.isinf(found.high):
        return "any value will do"
    if found.low == 0.0:
        return f"any value below {_figure(found.high)}" + ("" if fits else ": the assumed one is too large")
    if fits:
        return "as assumed"
    if assumed == 0.0:
        return "there is some, and none is assumed"
    factor = assumed / found.value
    return f"assumed {factor:.2f} times too large" if factor > 1 else f"assumed {1 / factor:.2f} times too small"


def systematic_verdict(found: Supported) -> str:
    """Whether a systematic error is one: its interval is without 0."""
    return "none to be seen" if found.low <= 0.0 <= found.high else THERE_IS


def _outliers(noise: Noise) -> Iterator[str]:
    for channel, rate in noise.rates.items():
        spread, unit = noise.values[f"{channel} spread"], UNITS[channel]
        share = f"{rate.value:.2%} ({rate.low:.2%} to {rate.high:.2%})"
        yield f"outliers: {share} of {channel}, with a spread of {spread:.3g} {unit}; the sigma above is of the others"
    for name, dof in noise.values.items():
        if name.endswith(" dof"):
            channel = name.removesuffix(" dof")
            yield f"heavy tails: {channel} has Student's t with {dof:.3g} degrees of freedom; its sigma is the scale"
    if noise.first_sights_left_out:
        yield f"first sights left out, which the next ones contradict: {noise.first_sights_left_out}"
    if noise.left_without_id:
        yield f"observations that find no landmark, and are left out: {noise.left_without_id}"


def _heading(noise: Noise) -> Iterator[str]:
    offset = noise.systematic.get("bearing_offset")
    if offset is not None and systematic_verdict(offset) == THERE_IS and not noise.keeps_assumed:
        other = "odometry" if noise.heading == "sensor" else "sensor"
        turned = "odometry is" if noise.heading == "sensor" else "bearings are"
        yield (
            f"sensor and odometry disagree by {offset.value:+.3g} rad on where straight ahead is, and the log cannot "
            f"tell whose the start's heading is: taken for the {noise.heading}'s, {turned} turned "
            f"(--heading {other}: the other)"
        )


def _nis(noise: Noise) -> Iterator[str]:
    for channel, after in noise.after.nis.items():
        before = noise.before.nis[channel]
        band = f"95 % band {after.low:.3f} to {after.high:.3f}"
        yield f"NIS of {channel}: {before.mean:.3f} as assumed, {after.mean:.3f} as found ({band}, {after.rows} rows)"


def _landmarks(after: Diagnosis) -> Iterator[str]:
    for channel, by_landmark in after.nis_by_landmark.items():
        outside = {each: nis for each, nis in by_landmark.items() if _is_outside(nis, len(by_landmark))}
        worst = sorted(outside, key=lambda each: -abs(math.log(max(outside[each].mean, 1e-9))))[:MANY]
        if worst:
            named = ", ".join(f"{each} ({outside[each].mean:.2f})" for each in worst)
            share = f"{len(outside)} of {len(by_landmark)}"
            yield f"{channel} is not alike for all landmarks: NIS is outside its band for {share}: {named}"


def _is_outside(nis: Nis, landmarks: int) -> bool:
    if not nis.rows:
        return False
    low, high = chi2_band(1.0 - (1.0 - LEVEL) / landmarks, nis.rows)
    return not low <= nis.mean * nis.rows <= high


def _whiteness(noise: Noise) -> Iterator[str]:
    for channel, correlation in noise.after.correlation.items():
        first, band = float(correlation[0]), noise.after.correlation_band[channel]
        if abs(first) > max(band, WORTH_SAYING):
            yield (
                f"{channel} is not white: successive sights of a landmark correlate by {first:+.2f} "
                f"(white: within {band:.2f}); intervals, which suppose white noise, are too narrow"
            )
    counted = noise.sights_counted_as_one
    if counted > 1.0:
        yield (
            f"errors last: {counted:.2g} sights of a landmark count as one within the filter's memory; covariances of "
            "observations are written that many times larger than found"
        )


def _gain(noise: Noise) -> Iterator[str]:
    yield f"log-likelihood: {noise.log_likelihood_gain:+z.1f} nats over the noise assumed"
    if noise.held_out is None:
        yield "held out: one half of the log tells too little to be fitted alone"
    else:
        gain, count = noise.held_out
        kept = "; it loses there, and the noise assumed is kept" if noise.keeps_assumed else ""
        yield (
            f"held out: the first half's noise gains {gain:+z.1f} nats on the {count} observations of the second "
            f"({gain / count:+z.3f} each){kept}"
        )
