"""Sentences about the noise of a recording.

A landmark is named if its NIS is outside the two-sided chi-square band that contains all landmarks with a probability
of 95 % if the noise is right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from slamgauge.compare.noise.diagnosis import Nis
from slamgauge.compare.noise.estimation import Noise
from slamgauge.compare.noise.tables import SIGNIFICANT, systematic_verdict
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import LEVEL

MANY = 5  # largest number of named landmarks or outliers
NEGLIGIBLE = 0.05  # a smaller correlation changes no interval by more than 5 %


def notes(noise: Noise) -> list[str]:
    """Return the sentences below the table."""
    parts = (_outliers, _heading, _nis, _landmarks, _correlation, _gain)
    return [line for part in parts for line in part(noise)]


def _outliers(noise: Noise) -> Iterator[str]:
    if noise.outliers:
        count = len(noise.outliers) + len(noise.recording.observation)
        largest = sorted(noise.outliers, key=lambda each: -math.inf if math.isnan(each.sigmas) else -each.sigmas)
        named = ", ".join(f"landmark {each.landmark} in step {each.step}" for each in largest[:MANY])
        yield (
            f"outliers: {len(noise.outliers)} of {count} observations ({noise.outlier_rate:.2%}) are excluded, "
            f"first {named}; the noise in the table is that of the others"
        )
    if noise.left_without_id:
        yield f"observations excluded, because they fit no landmark: {noise.left_without_id}"


def _heading(noise: Noise) -> Iterator[str]:
    offset = noise.systematic.get("bearing_offset")
    if offset is not None and systematic_verdict(offset) == SIGNIFICANT and not noise.keeps_assumed:
        other = "odometry" if noise.heading == "sensor" else "sensor"
        rotated = "odometry is" if noise.heading == "sensor" else "bearings are"
        yield (
            f"the forward directions of sensor and odometry differ by {offset.mean:+.3g} rad, and the log does not "
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
        outside = {each: nis.mean or 0.0 for each, nis in by_landmark.items() if _is_outside(nis, len(by_landmark))}
        worst = sorted(outside, key=lambda each: -abs(math.log(max(outside[each], 1e-9))))[:MANY]
        if worst:
            named = ", ".join(f"{each} (NIS {outside[each]:.2f})" for each in worst)
            share = f"{len(outside)} of {len(by_landmark)}"
            yield f"{channel} noise differs between landmarks: NIS is outside its band for {share}, most for {named}"


def _is_outside(nis: Nis, landmarks: int) -> bool:
    if nis.mean is None:
        return False
    low, high = chi2_band(1.0 - (1.0 - LEVEL) / landmarks, nis.rows)
    return not low <= nis.mean * nis.rows <= high


def _correlation(noise: Noise) -> Iterator[str]:
    for channel, (value, band) in noise.after.correlation.items():
        if abs(value) > max(band, NEGLIGIBLE):
            yield (
                f"{channel} errors are not white: successive errors of a landmark have a correlation of "
                f"{value:+.2f} (95 % limit for white noise {band:.2f}); the intervals assume white noise and are "
                "too narrow"
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
