"""The content of noise.json."""

from __future__ import annotations

from typing import Any

from pydantic_core import to_jsonable_python

from slamgauge.compare.noise.diagnosis import Nis
from slamgauge.compare.noise.estimation import Noise
from slamgauge.compare.noise.notes import notes
from slamgauge.compare.noise.parameters import UNITS
from slamgauge.compare.storage.result_files import origin


def noise_json(noise: Noise) -> dict[str, Any]:
    """Return the content of noise.json. An undetermined end of an interval is null."""
    before, after = noise.before, noise.after
    return {
        **origin(None),
        "parameters": {
            name: {
                "sigma": found.mean,
                "low": found.low,
                "high": found.high,
                "assumed": noise.assumed[name],
                "unit": UNITS[name],
            }
            for name, found in noise.parameters.items()
        },
        "outlier_rate": noise.outlier_rate,
        "outliers": to_jsonable_python([each._asdict() for each in noise.outliers], inf_nan_mode="null"),
        "systematic": {
            name: {"value": found.mean, "low": found.low, "high": found.high, "unit": UNITS[name]}
            for name, found in noise.systematic.items()
        },
        "heading": noise.heading,
        "nis_by_channel": {channel: _nis(before.nis[channel], nis) for channel, nis in after.nis.items()},
        "nis_by_landmark": {
            channel: {str(each): _nis(before.nis_by_landmark[channel][each], nis) for each, nis in by_landmark.items()}
            for channel, by_landmark in after.nis_by_landmark.items()
        },
        "autocorrelation": {
            channel: {"before": before.correlation[channel].value, "after": each.value, "band": each.band}
            for channel, each in after.correlation.items()
        },
        "log_likelihood_gain": noise.log_likelihood_gain,
        "held_out": None if noise.held_out is None else noise.held_out._asdict(),
        "left_without_id": noise.left_without_id,
        "notes": notes(noise),
    }


def _nis(before: Nis, after: Nis) -> dict[str, float | int | None]:
    return {"before": before.mean, "after": after.mean, "low": after.low, "high": after.high, "rows": after.rows}
