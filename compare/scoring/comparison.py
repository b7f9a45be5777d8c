"""Estimators run side by side on one recording: estimates, scores, table and files."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from slamgauge.arrays import chunks
from slamgauge.compare.estimators.registry import OPTIMA, REGISTRY
from slamgauge.compare.estimators.running import run_side_by_side
from slamgauge.compare.scoring.catalogue import RELATIVE, columns, empty_columns
from slamgauge.compare.scoring.implausible import WHY, is_too_near_the_truth
from slamgauge.compare.scoring.optimum_figures import is_in_doubt, is_misfit
from slamgauge.compare.scoring.optimum_notes import (
    MARK,
    distance_from_optimum,
    doubt,
    fit_of_the_model,
    left_out,
    misfits,
    told_apart,
    under_associations,
)
from slamgauge.compare.scoring.scores import Score, evaluate
from slamgauge.compare.scoring.text_page import Grid, Page
from slamgauge.compare.scoring.text_table import cell, marked
from slamgauge.compare.scoring.verdicts import single_run, verdict_lines
from slamgauge.compare.storage.provenance import origin
from slamgauge.display import data_frame
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator, Kind
from slamgauge.recording import Recording
from slamgauge.truth import Truth, require_same_run
from slamgauge.validation import require_type


@dataclass(frozen=True)
class Comparison:
    """What came out: the estimate and the score of each estimator, by name, and who is the optimum of which kind.

    `failures` has those without: the reason in a line, by name. `stand_ins` are optima that were told the associations
    of an estimator, since nobody knows the true ones.
    """

    truth: Truth | None
    recording: Recording
    estimates: dict[str, Estimate]
    scores: dict[str, Score]
    optima: dict[Kind, str] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    stand_ins: tuple[str, ...] = ()

    def __repr__(self) -> str:
        failed = f"; failed: {', '.join(self.failures)}" if self.failures else ""
        return f"Comparison({', '.join(self.scores)}{failed})"

    def _repr_html_(self) -> str:
        return table(self).html()

    def to_frame(self) -> Any:
        """The scores as a `pandas.DataFrame`: a row for each estimator, the keys of metrics.json that are figures."""
        entries = {name: score.figures() for name, score in self.scores.items()}
        keys = dict.fromkeys(key for entry in entries.values() for key in entry)
        return data_frame({key: [entry.get(key) for entry in entries.values()] for key in keys}, [*entries])


def compare_estimators(
    truth: Truth | None,
    recording: Recording,
    estimators: Mapping[str, Estimator],
    informed: Recording | None = None,
) -> Comparison:
    """Run every estimator, then score each against truth and optimum.

    Estimators see the recording alone. Two are optima: `causal`, the optimum of filtered estimates, and `batch`,
    that of smoothed ones, show what the measurements allow to somebody whom nothing misleads. What makes them so is
    their entry in the registry of estimators, not the name that they are given here.

    Args:
        truth: as much of the truth as is known.
        recording: what estimators see.
        estimators: by name.
        informed: the same measurements with their true noise and associations, which the optima see; by
            default the recording, with the truth's associations where it has no ids of its own.

    Raises:
        UserError: the truth is of another recording; or every estimator raised, or returned what does not fit.
    """
    require_type("recording", recording, Recording)
    require_type("estimators", estimators, Mapping)
    require_same_run(truth, recording)
    if informed is None:
        informed = recording
        if recording.landmark is None and truth is not None and truth.association is not None:
            informed = replace(recording, landmark=truth.association.clip(min=0))  # clutter is told apart in any case
    ran = run_side_by_side(estimators, recording, informed, None if truth is None else truth.misleading)
    estimates, seconds, optima, failures = ran.estimates, ran.seconds, ran.optima, ran.failures
    scores: dict[str, Score] = {}
    best = {kind: estimates[name] for kind, name in optima.items()}
    for name, estimate in estimates.items():
        try:
            score = evaluate(truth, recording, estimate, best.get(estimate.kind), best.get("smoothed"))
        except UserError as error:
            failures[name] = f"estimator {name}: {error}"
            continue
        scores[name] = score if estimate.seconds is not None else replace(score, seconds_total=seconds.get(name))
    if not scores and failures:
        raise UserError(next(iter(failures.values())))
    estimates = {name: estimates[name] for name in scores}
    return Comparison(truth, recording, estimates, scores, optima, failures, tuple(ran.stand_ins))


def metrics(
    comparison: Comparison, scenario: str | None, seed: int | None, scenario_text: str | None = None
) -> dict[str, Any]:
    """The content of metrics.json; scenario, its text and seed are None for a stored recording."""
    return {
        **origin(scenario_text),
        "scenario": scenario,
        "seed": seed,
        "digest": digest(comparison.recording),
        "truth": comparison.truth is not None and comparison.truth.poses is not None,
        "estimators": {name: score.to_json() for name, score in comparison.scores.items()},
        "failures": [{"estimator": name, "error": error} for name, error in comparison.failures.items()],
        "notes": remarks(comparison),
    }


def digest(recording: Recording) -> str:
    """SHA-256 of a recording's fields: equal digests, equal measurements."""
    total = hashlib.sha256()
    for each in fields(recording):
        value = getattr(recording, each.name)
        total.update(each.name.encode())
        for part in [value] if not np.ndim(value) else (value[rows] for rows in chunks(len(value))):
            total.update(part.tobytes() if isinstance(part, np.ndarray) else str(part).encode())
    return total.hexdigest()


def table(comparison: Comparison) -> Page:
    """The scores as a table, filtered estimates before smoothed ones; `-` where none applies.

    Figures relative to an optimum that its check puts in doubt are marked; what there is to say of the optima stands
    below the table.
    """
    found = columns("run")
    optima = {kind: comparison.estimates[name] for kind, name in comparison.optima.items()}
    doubtful = {kind for kind, optimum in optima.items() if is_in_doubt(optimum.optimum_check) or is_misfit(optimum)}
    rows = [["estimator", "kind", *(title for title, _, _ in found)]]
    for name, score in sorted(comparison.scores.items(), key=lambda item: item[1].kind):
        cells = [cell(score.figure(key), form) for _, key, form in found]
        if doubtful:
            cells = [
                marked(text, MARK, is_marked=score.kind in doubtful) if key in RELATIVE else text
                for text, (_, key, _) in zip(cells, found, strict=True)
            ]
        rows.append([name, score.kind, *cells])
    rows += [[name, "failed", *("-" for _ in found)] for name in comparison.failures]
    notes = [*optimum_notes(comparison), *remarks(comparison)]
    verdicts = verdict_lines({name: score.verdict for name, score in comparison.scores.items()})
    return Page((Grid(rows, words=2), *notes, *verdicts, *comparison.failures.values()))


def remarks(comparison: Comparison) -> list[str]:
    """Return notes on the run: what estimates are compared with, empty columns, and that it is a single run."""
    scores = comparison.scores.values()
    optima = sorted(comparison.optima.values())
    known = misfits([name for name in optima if is_misfit(comparison.estimates[name])])
    told = None if comparison.stand_ins else told_apart(optima, comparison.truth)
    found = [line for line in (known, told) if line]
    found += [] if not comparison.stand_ins else [under_associations(comparison.stand_ins)]
    found += empty_columns("run", lambda key: all(score.figure(key) is None for score in scores))
    return found if all(score.ate_m is None for score in scores) else [*found, single_run()]


def too_near(name: str, comparison: Comparison) -> str | None:
    """What to say of an estimate that is nearer to the truth than chance allows; None if it is not."""
    causal = comparison.optima.get("filtered")
    if causal is None or comparison.truth is None or comparison.stand_ins or is_misfit(comparison.estimates[causal]):
        return None
    if not is_too_near_the_truth(comparison.truth, comparison.estimates[name], comparison.estimates[causal]):
        return None
    return f"{name}: nearer to the truth than chance allows with what {causal} is sure of: {WHY}"


def optimum_notes(comparison: Comparison) -> list[str]:
    """What there is to say of the optima: the fit of the model, what they leave out, which of them is in doubt."""
    notes: list[str | None] = []
    judges = [(kind, comparison.optima[kind]) for kind in ("smoothed", "filtered") if kind in comparison.optima]
    if judges:
        kind, name = judges[0]
        notes.append(fit_of_the_model(REGISTRY[OPTIMA[kind]].title, comparison.estimates[name]))
    for _, name in judges:
        notes.append(left_out(name, comparison.truth, comparison.recording, comparison.estimates[name]))
    notes += [doubt(name, comparison.estimates[name].optimum_check) for _, name in judges]
    others = {name: each for name, each in comparison.estimates.items() if name not in comparison.optima.values()}
    notes += [distance_from_optimum(name, each.optimum_check) for name, each in others.items()]
    notes += [too_near(name, comparison) for name in others]
    return [note for note in notes if note]
