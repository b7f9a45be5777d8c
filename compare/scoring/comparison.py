"""Estimators run side by side on one recording: estimates, scores, table and files."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from tqdm import tqdm

from slamgauge.compare.estimators.loading import entry_behind
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scoring.catalogue import columns
from slamgauge.compare.scoring.scores import Score, evaluate
from slamgauge.compare.scoring.text_table import aligned, cell
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator, Kind
from slamgauge.recording import Recording
from slamgauge.truth import Truth, require_same_run


@dataclass(frozen=True)
class Comparison:
    """What came out: the estimate and the score of each estimator, by name."""

    truth: Truth | None
    recording: Recording
    estimates: dict[str, Estimate]
    scores: dict[str, Score]


def compare_estimators(
    truth: Truth | None,
    recording: Recording,
    estimators: Mapping[str, Estimator],
    informed: Recording | None = None,
) -> Comparison:
    """Run every estimator, then score each against truth and optimum.

    Estimators see the recording alone. Two are yardsticks: `isam2`, the optimum of filtered estimates, and `batch`,
    that of smoothed ones, show what the measurements allow to somebody whom nothing misleads. What makes them so is
    their entry in the registry of estimators, not the name that they are given here.

    Args:
        truth: as much of the truth as is known.
        recording: what estimators see.
        estimators: by name.
        informed: the same measurements with their true noise and associations, which the yardsticks see; by
            default the recording, with the truth's associations where it has no ids of its own.

    Raises:
        UserError: the truth is of another recording; an estimator raised, or returned what does not fit, and
            then the estimator is named.
    """
    require_same_run(truth, recording)
    if informed is None:
        informed = recording
        if recording.landmark is None and truth is not None and truth.association is not None:
            informed = recording.associated(truth.association)
    estimates: dict[str, Estimate] = {}
    seconds: dict[str, float] = {}
    optima: dict[Kind, Estimate] = {}
    progress = tqdm(estimators.items(), disable=None, leave=False, unit="estimator")
    for name, estimator in progress:
        progress.set_description(name)
        entry = entry_behind(estimator)
        is_yardstick = entry is not None and entry.is_yardstick
        estimates[name], seconds[name] = run_estimator(name, estimator, informed if is_yardstick else recording)
        if is_yardstick:
            optima[estimates[name].kind] = estimates[name]
    scores: dict[str, Score] = {}
    for name, estimate in estimates.items():
        optimum = optima.get(estimate.kind)
        try:
            score = evaluate(truth, recording, estimate, optimum, optima.get("smoothed"))
        except UserError as error:
            raise UserError(f"estimator {name}: {error}") from error
        scores[name] = score if estimate.seconds is not None else replace(score, seconds_total=seconds[name])
    return Comparison(truth, recording, estimates, scores)


def metrics(comparison: Comparison, scenario: str | None, seed: int | None) -> dict[str, Any]:
    """The content of metrics.json; scenario and seed are None for a stored recording."""
    return {
        "scenario": scenario,
        "seed": seed,
        "digest": digest(comparison.recording),
        "truth": comparison.truth is not None and comparison.truth.poses is not None,
        "estimators": {name: score.to_json() for name, score in comparison.scores.items()},
    }


def digest(recording: Recording) -> str:
    """SHA-256 of a recording's fields: equal digests, equal measurements."""
    total = hashlib.sha256()
    for field in fields(recording):
        value = getattr(recording, field.name)
        total.update(field.name.encode())
        total.update(value.tobytes() if isinstance(value, np.ndarray) else str(value).encode())
    return total.hexdigest()


def table(comparison: Comparison) -> str:
    """The scores as a text table, filtered estimates before smoothed ones; `-` where none applies."""
    found = columns("run")
    rows = [["estimator", "kind", *(title for title, _, _ in found)]]
    for name, score in sorted(comparison.scores.items(), key=lambda item: item[1].kind):
        rows.append([name, score.kind, *(cell(score.figure(key), form) for _, key, form in found)])
    return "\n".join(aligned(rows, words=2))
