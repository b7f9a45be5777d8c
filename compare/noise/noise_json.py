"""The content of noise.json: the noise of a recording in figures and sentences.

A sentence names a landmark if its NIS is outside the two-sided chi-square band that contains all landmarks with a
probability of 95 % if the noise is right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pydantic_core import to_jsonable_python

from slamgauge.compare.noise.diagnosis import Nis
from slamgauge.compare.noise.estimation import Noise
from slamgauge.compare.noise.parameters import UNITS
from slamgauge.compare.noise.tables import SIGNIFICANT, systematic_verdict
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import LEVEL
from slamgauge.compare.storage.result_files import origin

MANY = 5  # largest number of named landmarks or outliers
NEGLIGIBLE = 0.05  # a smaller correlation changes no interval by more than 5 %


def noise_json(noise: Noise) -> dict[str, Any]:
    """Return the content of noise.json. An undetermined end of an interval is null."""
    before, after = noise.before, noise.after
    content: dict[str, Any] = {
        **origin(None),
        "parameters": {
            name: {"sigma": found.mean, "low": found.low, "high": found.high, "assumed": noise.assumed[name]}
            for name, found in noise.parameters.items()
        },
        "outlier_rate": noise.outlier_rate,
        "outliers": [each._asdict() for each in noise.outliers],
        "systematic": {
            name: {"value": found.mean, "low": found.low, "high": found.high}
            for name, found in noise.systematic.items()
        },
        "heading": noise.heading,
        "nis_by_channel": {channel: _nis(before.nis[channel], nis) for channel, nis in after.nis.items()},
        "nis_by_landmark": {
            channel: {each: _nis(before.nis_by_landmark[channel][each], nis) for each, nis in by_landmark.items()}
            for channel, by_landmark in after.nis_by_landmark.items()
        },
        "autocorrelation": {
            channel: {"before": before.correlation[channel].value, "after": each.value, "band": each.band}
            for channel, each in after.correlation.items()
        },
        "log_likelihood_gain": noise.log_likelihood_gain,
        "held_out": None if noise.held_out is None else noise.held_out._asdict(),
        "left_without_id": noise.left_without_id,
        "notes": [line for part in NOTES for line in part(noise)],
    }
    for name, each in (content["parameters"] | content["systematic"]).items():
        each["unit"] = UNITS[name]
    return to_jsonable_python(content, inf_nan_mode="null")


def _nis(before: Nis, after: Nis) -> dict[str, float | int | None]:
    return {"before": before.mean, "after": after.mean, "low": after.low, "high": after.high, "rows": after.rows}


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


def _nis_of_channels(noise: Noise) -> Iterator[str]:
    for channel, after in noise.after.nis.items():
        yield (
            f"NIS of {channel} (mean squared normalised innovation, 1 if the noise is right): "
            f"{noise.before.nis[channel].mean:.3f} with the assumed noise, {after.mean:.3f} with the noise found "
            f"(95 % band {after.low:.3f} to {after.high:.3f}, {after.rows} innovations)"
        )


def _landmarks(noise: Noise) -> Iterator[str]:
    for channel, by_landmark in noise.after.nis_by_landmark.items():
        outside: dict[int, float] = {}
        for each, nis in by_landmark.items():
            low, high = chi2_band(1.0 - (1.0 - LEVEL) / len(by_landmark), nis.rows) if nis.rows else (0.0, 0.0)
            if nis.mean is not None and not low <= nis.mean * nis.rows <= high:
                outside[each] = nis.mean
        worst = sorted(outside, key=lambda each: -abs(math.log(max(outside[each], 1e-9))))[:MANY]
        if worst:
            named = ", ".join(f"{each} (NIS {outside[each]:.2f})" for each in worst)
            share = f"{len(outside)} of {len(by_landmark)}"
            yield f"{channel} noise differs between landmarks: NIS is outside its band for {share}, most for {named}"


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


NOTES = (_outliers, _heading, _nis_of_channels, _landmarks, _correlation, _gain)
