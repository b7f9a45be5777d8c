"""Estimators side by side on one recording: estimates, scores, table and files."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgauge.compare.estimators.registry import OPTIMA, REGISTRY
from slamgauge.compare.estimators.running import own_poses_of, run_side_by_side
from slamgauge.compare.scoring.catalogue import figure_cells, heads
from slamgauge.compare.scoring.optimum_notes import (
    MARKED,
    doubt,
    fit_of_the_model,
    is_in_doubt,
    is_misfit,
    left_out,
    misfits,
)
from slamgauge.compare.scoring.own_stamps import optimum_at, truth_at
from slamgauge.compare.scoring.scores import Score, evaluate
from slamgauge.compare.scoring.table import ESTIMATOR, KIND, NO_FIGURE, Cell, Page, Table
from slamgauge.compare.storage.files import save, write_json
from slamgauge.compare.storage.result_files import METRICS, RECORDING, TRUTH, origin
from slamgauge.compare.storage.trajectories import write_tum
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator, Kind
from slamgauge.recording import Recording
from slamgauge.truth import Truth, require_same_run
from slamgauge.validation import require_type

if TYPE_CHECKING:
    from slamgauge.compare.scoring.without_truth import ConsistencyTest

# relative standard deviation of the ATE between runs whose errors last for the whole run: that of a Rayleigh variable
SCATTER = math.sqrt(4 / math.pi - 1)


@dataclass(frozen=True)
class Comparison:
    """Comparison of estimators on one recording.

    `recording` is what estimators received; `truth` is None for a robot's log. `estimates` and `scores` are by the name
    of the estimator, `optima` are the names of the optima by kind. `failures` has the reason, in a line, for each
    estimator without a score. `stand_ins` are optima with the associations of an estimator, if the true ones are
    unknown. `study` is a command of many runs, if the recording is simulated. `remarks` are those on user code, for
    example replaced settings. `without_truth` has the tests of `scoring.without_truth` on filters.
    """

    truth: Truth | None
    recording: Recording
    estimates: dict[str, Estimate]
    scores: dict[str, Score]
    optima: dict[Kind, str] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    stand_ins: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    without_truth: Mapping[str, ConsistencyTest] = field(default_factory=dict[str, "ConsistencyTest"])
    study: str = ""

    def __repr__(self) -> str:
        failed = f"; failed: {', '.join(self.failures)}" if self.failures else ""
        return f"Comparison({', '.join(self.scores)}{failed})"

    def _repr_html_(self) -> str:
        return table(self).html()


def compare_estimators(
    truth: Truth | None,
    recording: Recording,
    estimators: Mapping[str, Estimator],
    informed: Recording | None = None,
    *,
    twins: int = 0,
) -> Comparison:
    """Run every estimator, then score each relative to truth and optimum.

    Estimators receive only the recording. Two estimators are optima, by their entry in the registry and not by their
    name here: `causal` for filtered estimates and `batch` for smoothed ones.

    Args:
        truth: the known part of the truth.
        recording: input of the estimators.
        estimators: by name.
        informed: the same measurements with true noise and associations, as input of the optima; by default the
            recording, with the truth's associations if it has no ids.
        twins: number of simulated twins of the test that needs no ground truth; 0: no test.

    Raises:
        UserError: the truth is of another recording, no estimator returned a valid estimate, or the test lacks `batch`.
    """
    require_type("recording", recording, Recording)
    require_type("estimators", estimators, Mapping)
    require_same_run(truth, recording)
    if informed is None and recording.landmark is None and truth is not None and truth.association is not None:
        informed = replace(recording, landmark=truth.association.clip(min=0))  # `misleading` marks clutter anyway
    misleading = None if truth is None else truth.misleading
    ran = run_side_by_side(estimators, recording, informed or recording, misleading)
    if not ran.estimates and ran.failures:
        raise UserError(next(iter(ran.failures.values())))
    scores: dict[str, Score] = {}
    own = {name: own_poses_of(estimators.get(name)) for name in ran.estimates}
    best = {kind: ran.estimates[name] for kind, name in ran.optima.items()}
    for name, estimate in ran.estimates.items():
        optimum, stored = best.get(estimate.kind), own[name]
        if stored is None:
            score = evaluate(truth, recording, estimate, optimum)
        else:  # at its own stamps
            best_there = optimum and optimum_at(stored.stamps, optimum, recording)
            true_there = truth_at(stored.stamps, truth, recording)
            score = evaluate(true_there, recording, stored.estimate, best_there, stored.compared)
        scores[name] = score if estimate.seconds is not None else score.timed(ran.seconds.get(name))
    tests: Mapping[str, ConsistencyTest] = {}
    if twins:
        from slamgauge.compare.scoring.without_truth import tested_filters  # loads the optima

        if "smoothed" not in best:
            raise UserError("twins: the test needs the optimum of all measurements; add batch to --estimators")
        tests = tested_filters(recording, ran.estimates, best["smoothed"], twins, own)
    return Comparison(
        truth,
        recording,
        estimates=ran.estimates,
        scores=scores,
        optima=ran.optima,
        failures=ran.failures,
        stand_ins=tuple(ran.stand_ins),
        remarks=tuple(f"{name}: {remark}" for name, remarks in ran.remarks.items() for remark in remarks),
        without_truth=tests,
    )


def metrics(
    comparison: Comparison, scenario: str | None, seed: int | None, scenario_text: str | None = None
) -> dict[str, Any]:
    """Return the content of metrics.json; a stored recording has no scenario, text and seed (None)."""
    tests = {name: test.to_json(comparison.recording.stamps) for name, test in comparison.without_truth.items()}
    return {
        **origin(scenario_text),
        "scenario": scenario,
        "seed": seed,
        "digest": digest(comparison.recording),
        "truth": comparison.truth is not None and comparison.truth.poses is not None,
        "estimators": {name: score.to_json() for name, score in comparison.scores.items()},
        "failures": [{"estimator": name, "error": error} for name, error in comparison.failures.items()],
        "notes": [*notes(comparison), *comparison.remarks],
        **({"without_truth": tests} if tests else {}),
    }


def digest(recording: Recording) -> str:
    """Return the SHA-256 of a recording's fields: equal digests mean equal measurements."""
    total = hashlib.sha256()
    for each in fields(recording):
        value = getattr(recording, each.name)
        total.update(each.name.encode())
        total.update(np.ascontiguousarray(value).data if isinstance(value, np.ndarray) else str(value).encode())
    return total.hexdigest()


def run_table(
    scores: Mapping[str, Mapping[str, Any]], doubtful: Collection[Kind] = (), failed: Iterable[str] = ()
) -> Table:
    """Return the scores, or their entries in metrics.json, as a table, filtered estimates before smoothed ones.

    Columns without any figure are left out, and the position NEES if there is a pose NEES. Figures relative to an
    optimum in doubt are marked, and estimators without a score follow.
    """
    found = [head for head in heads("run") if any(score[head.key] is not None for score in scores.values())]
    if any(head.key == "nees_pose" for head in found):
        found = [head for head in found if head.key != "nees_position"]
    rows: list[list[Cell | str]] = []
    for name, score in sorted(scores.items(), key=lambda item: item[1]["kind"]):
        cells = figure_cells(score, found, score["kind"] in doubtful if doubtful else None)
        rows.append([name, score["kind"], *cells])
    rows += [[name, "failed", *(NO_FIGURE for _ in found)] for name in failed]
    return Table.of([ESTIMATOR, KIND, *found], rows, "Metrics of the whole run; click a column title to sort", "scores")


def doubtful_kinds(optima: Mapping[Kind, Estimate]) -> set[Kind]:
    """Return the kinds of estimates whose optimum is in doubt."""
    return {kind for kind, each in optima.items() if is_in_doubt(each.optimum_check) or is_misfit(each)}


def table(comparison: Comparison) -> Page:
    """Return the scores as a table, with notes below."""
    optima = {kind: comparison.estimates[name] for kind, name in comparison.optima.items()}
    scores = run_table(comparison.scores, doubtful_kinds(optima), comparison.failures)
    verdicts = [f"{name}: {score['verdict']}" for name, score in comparison.scores.items() if score["verdict"]]
    return Page((scores, *notes(comparison), *verdicts, *comparison.failures.values()))


def notes(comparison: Comparison) -> list[str]:
    """Return notes on the run, and on the optima: their model, associations, doubts and betters."""
    estimates, truth = comparison.estimates, comparison.truth
    found: list[str | None] = []
    if any(score["ate_m"] is not None for score in comparison.scores.values()):
        more = f". For conclusions use many runs: {comparison.study}" if comparison.study else ""
        found.append(f"One run: from run to run the ATE varies by about {100 * SCATTER:.0f} % of its mean{more}")
    optima = sorted(comparison.optima.values())
    found.append(misfits([name for name in optima if is_misfit(estimates[name])]))
    if not len(comparison.recording.observation):
        found.append("no landmark was observed: all estimates are dead reckoning")
    if comparison.stand_ins:
        names = " and ".join(comparison.stand_ins)
        found.append(f"no ids, and no true associations: compared with {names}, with associations right or wrong")
    if truth is not None and truth.poses is not None:
        headless = np.isfinite(truth.poses[:, 0]) & np.isnan(truth.poses[:, 2])
        where = "" if headless.all() else f" at {headless.sum()} of {len(headless)} steps"
        left = "heading errors, relative errors and pose NEES are left out there"
        found.append(f"the truth has no headings{where}: {left}" if headless.any() else None)
    if optima:
        kind = "smoothed" if "smoothed" in comparison.optima else "filtered"
        found.append(fit_of_the_model(REGISTRY[OPTIMA[kind]].title, estimates[comparison.optima[kind]]))
    found += [left_out(name, truth, comparison.recording, estimates[name]) for name in optima]
    found += [doubt(name, estimates[name].optimum_check, MARKED) for name in optima]
    found += [doubt(name, each.optimum_check) for name, each in estimates.items() if name not in optima]
    found += [f"{name}: {test.text()}" for name, test in comparison.without_truth.items()]
    return [line for line in found if line]


def write_comparison(folder: Path, comparison: Comparison, content: dict[str, Any]) -> None:
    """Write recording, truth, estimates, TUM trajectories and metrics into an existing, empty folder."""
    recording, truth = comparison.recording, comparison.truth
    save(folder / RECORDING, recording)
    (folder / "estimates").mkdir()
    (folder / "trajectories").mkdir()
    for name, estimate in comparison.estimates.items():
        save(folder / "estimates" / f"{name}.npz", estimate)
        write_tum(folder / "trajectories" / f"{name}.tum", recording.stamps, estimate.poses)
    if truth is not None:
        save(folder / TRUTH, truth)
    if truth is not None and truth.poses is not None:
        write_tum(folder / "trajectories" / "truth.tum", recording.stamps, truth.poses)
    write_json(folder / METRICS, content)
