"""Score of an estimate: the figures of metrics.json, relative to the truth and to the optimum."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydantic_core import to_jsonable_python

from slamgauge.arrays import Float, Marks
from slamgauge.compare.scoring.catalogue import BY_KEY, Measured, measured
from slamgauge.display import html_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth, require_same_run
from slamgauge.validation import require_type


@dataclass(frozen=True, eq=False, repr=False)
class FiguresByKey(Mapping[str, Any]):
    """Kind and figures of an estimator by their keys in `catalogue`; None if a figure does not apply."""

    figures: dict[str, Any]

    def __getitem__(self, key: str) -> Any:
        return self.figures[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self.figures)

    def __len__(self) -> int:
        return len(self.figures)

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers, lists and None, as in files; an infinite check becomes the largest double."""
        finite = {key: sys.float_info.max if value == math.inf else value for key, value in self.items()}
        return to_jsonable_python(finite)  # JSON has no infinity


@dataclass(frozen=True, eq=False, repr=False)
class Score(FiguresByKey):
    """Figures of an estimate, for example `score["ate_m"]`: its entry in metrics.json.

    `kind` is a key, too: "filtered" (compared with `causal`) or "smoothed" (compared with `batch`).

    Attributes:
        figures: the figures by key (see the glossary).
        nees: (N+1,) pose NEES of each step, NaN where undefined.
        sigmas: (N+1, 3) standard deviations of x, y [m] and heading [rad], NaN where undefined.
    """

    nees: Float
    sigmas: Float

    def __repr__(self) -> str:
        known = {"ATE [m]": self["ate_m"], "NEES": self["nees_pose"], "NIS/dof": self["nis_per_dof"]}
        parts = [f"{title} {value:.3g}" for title, value in known.items() if value is not None]
        return f"Score({', '.join([self['kind'], *parts])})"

    def _repr_html_(self) -> str:
        numbers = {key: value for key, value in self.to_json().items() if isinstance(value, int | float)}
        rows = [(key, f"{value:.4g}", BY_KEY[key].help) for key, value in numbers.items()]
        return html_table((f"{self['kind']} estimate", "", ""), rows)

    def timed(self, seconds: float | None) -> Score:
        """Return the score with this computing time [s]."""
        return replace(self, figures={**self.figures, "seconds_total": seconds})


def evaluate(
    truth: Truth | None,
    recording: Recording,
    estimate: Estimate,
    optimum: Estimate | None = None,
    compared: Marks | None = None,
) -> Score:
    """Score an estimate against the truth and the optimum of the same kind.

    Args:
        truth: the known part of the truth; None on real data without ground truth.
        recording: input of the estimator.
        estimate: output of the estimator.
        optimum: estimate of `causal` if `estimate` is filtered, of `batch` if it is smoothed.
        compared: (N+1,) the steps at which poses are scored; None: all.

    Raises:
        UserError: lengths do not fit the recording, or the optimum is of another kind.
    """
    truth = Truth() if truth is None else truth
    require_type("truth", truth, Truth)
    require_type("recording", recording, Recording)
    require_type("estimate", estimate, Estimate)
    require_same_run(truth, recording)
    rows = {"poses": recording.steps + 1, "association": len(recording.observation)}
    if optimum is not None and optimum.kind != estimate.kind:
        remedy = "compare a filtered estimate with causal, a smoothed one with batch"
        raise UserError(f"optimum.kind: {optimum.kind!r} instead of {estimate.kind!r}; {remedy}")
    for name, each in {"estimate": estimate, "optimum": optimum}.items():
        for field, count in rows.items():
            values = getattr(each, field, None)
            if values is not None and len(values) != count:
                raise UserError(f"{name}.{field}: {len(values)} rows, but the recording needs {count}; give its own")
    found = Measured(truth, recording, estimate, optimum, compared)
    return Score({"kind": estimate.kind, **measured(found)}, found.nees, found.sigmas)
