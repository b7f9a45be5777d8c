"""The content of noise.json."""

from __future__ import annotations

import math
from typing import Any

from slamgauge.arrays import Float
from slamgauge.compare.noise.diagnosis import Nis, normal_quantiles, quantiles
from slamgauge.compare.noise.estimation import Noise
from slamgauge.compare.noise.likelihood import Interval
from slamgauge.compare.noise.parameters import UNITS
from slamgauge.compare.noise.report_text import lines
from slamgauge.compare.storage.provenance import origin


def noise_json(noise: Noise) -> dict[str, Any]:
    """Return the content of noise.json. Infinite ends of intervals, and NIS that do not exist, are None."""
    before, after = noise.before, noise.after
    return {
        **origin(None),
        "parameters": {
            name: {"sigma": found.value, **_ends(found), "assumed": noise.assumed[name], "unit": UNITS[name]}
            for name, found in noise.parameters.items()
        },
        "outlier_rate": noise.outlier_rate,
        "outliers": {
            channel: {"rate": rate.value, **_ends(rate), "spread": noise.values[f"{channel} spread"]}
            for channel, rate in noise.rates.items()
        },
        "student_t_dof": {
            name.removesuffix(" dof"): dof for name, dof in noise.values.items() if name.endswith(" dof")
        },
        "systematic": {
            name: {"value": found.value, **_ends(found), "unit": UNITS[name]}
            for name, found in noise.systematic.items()
        },
        "heading": noise.heading,
        "nis_by_channel": {channel: _nis(before.nis[channel], nis) for channel, nis in after.nis.items()},
        "nis_by_landmark": {
            channel: {str(each): _nis(before.nis_by_landmark[channel][each], nis) for each, nis in by_landmark.items()}
            for channel, by_landmark in after.nis_by_landmark.items()
        },
        "quantiles": {channel: _quantiles(before.scores[channel], each) for channel, each in after.scores.items()},
        "autocorrelation": {
            channel: {
                "before": before.correlation[channel].tolist(),
                "after": each.tolist(),
                "band": after.correlation_band[channel],
            }
            for channel, each in after.correlation.items()
        },
        "log_likelihood_gain": noise.log_likelihood_gain,
        "held_out": None if noise.held_out is None else noise.held_out._asdict(),
        "sights_counted_as_one": noise.sights_counted_as_one,
        "first_sights_left_out": noise.first_sights_left_out,
        "left_without_id": noise.left_without_id,
        "notes": lines(noise),
    }


def supported(value: float, found: dict[str, Any], lowest: float = 0.0) -> Interval:
    """Return a value of noise.json with its interval; a low end None becomes `lowest`, a high end None infinity."""
    low, high = found["low"], found["high"]
    return Interval(value, lowest if low is None else low, math.inf if high is None else high)


def _ends(found: Interval) -> dict[str, float | None]:
    return {"low": _finite(found.low), "high": _finite(found.high)}


def _nis(before: Nis, after: Nis) -> dict[str, float | int | None]:
    means = {"before": _finite(before.mean), "after": _finite(after.mean)}
    return {**means, "low": _finite(after.low), "high": _finite(after.high), "rows": after.rows}


def _quantiles(before: Float, after: Float) -> dict[str, list[float]]:
    if not before.size or not after.size:
        return {"normal": [], "before": [], "after": []}
    normal = normal_quantiles(after.size)
    found = {"normal": normal, "before": quantiles(before, normal), "after": quantiles(after, normal)}
    return {key: each.tolist() for key, each in found.items()}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
