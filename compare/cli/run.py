"""Estimators on one recording: `slamgauge run` and `evaluate`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from slamgauge.compare.cli.options import (
    Estimators,
    Folder,
    Overrides,
    OwnCode,
    flattened,
    print_result,
    results_folder,
    split_names,
)
from slamgauge.compare.cli.pages import PageOptions, write_page
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.storage.result_files import METRICS
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from slamgauge.compare.estimators.requests import Asked
    from slamgauge.compare.scenarios.scenario import Scenario
    from slamgauge.compare.scenarios.schema import Association
    from slamgauge.ekf.settings.initialisation import Initialisation
    from slamgauge.ekf.settings.robustness import Robustness
    from slamgauge.estimate import Estimate, Estimator
    from slamgauge.recording import Recording
    from slamgauge.truth import Truth

DEFAULT_ESTIMATORS = "ekf,riekf,causal,batch"
FRAMES = 240  # maps that filters keep for pictures


@dataclass
class Run:
    """Simulate one run of a scenario and grade estimators on it.

    For example:
      slamgauge run q1-long-dense --estimators ekf,riekf,causal,batch
      slamgauge run q2-long-dense --seed 3 --set association.gate=25
    """

    scenario: tyro.conf.Positional[str]
    """A shipped name (`slamgauge scenarios` lists them) or the path of a TOML file."""

    seed: int = 0
    """Seed of all noise."""

    estimators: Estimators = DEFAULT_ESTIMATORS

    own_code: OwnCode = field(default_factory=OwnCode)

    set: Overrides = field(default_factory=list)
    """Override keys of the scenario: dotted.key=value ..."""

    out: Folder | None = None
    """Folder of the results; results/SCENARIO-seed-SEED if not given."""

    page: PageOptions = field(default_factory=PageOptions)

    output: Output = field(default_factory=Output)

    def __call__(self) -> int:
        """Simulate, grade and write; the exit status."""
        from slamgauge.compare.scenarios.scenario import load_scenario
        from slamgauge.compare.storage.safe_names import file_name

        scenario = load_scenario(self.scenario, flattened(self.set))
        out = self.out or Path("results") / f"{file_name(scenario.name)}-seed-{self.seed}"
        status = self._grade(scenario, out)  # what it needs of memory is free again before the page is written
        return status if write_page(out, METRICS, self.page) else 1

    def _grade(self, scenario: Scenario, out: Path) -> int:
        from slamgauge.compare.estimators.memory_check import require_room_for_estimates
        from slamgauge.compare.estimators.requests import ask
        from slamgauge.compare.scenarios.scenario_text import scenario_text
        from slamgauge.compare.scenarios.simulation import simulate_informed
        from slamgauge.compare.storage.manifest import require_free
        from slamgauge.compare.storage.result_files import comparison_files

        asked = self.own_code.kept_apart(ask(split_names(self.estimators)))
        require_free(out, comparison_files(each.label for each in asked))
        truth, recording, told = simulate_informed(scenario, self.seed)
        require_room_for_estimates(told, len(asked))
        title = f"{scenario.name}, seed {self.seed}"
        grading = Grading(
            asked,
            out,
            self.output.json,
            title,
            scenario.association,
            scenario.initialisation_settings,
            scenario.robustness,
            scenario.name,
            self.seed,
            scenario_text(scenario),
        )
        return grading.grade(truth, recording, told)


@dataclass
class Evaluate:
    """Grade estimators, your own among them, on a stored recording.

    With a truth that has associations, causal and batch use these; where nobody knows them, they use those of the first
    estimator that makes any (causal@ekf). The noise that all assume is the recording's.

    For example:
      slamgauge evaluate first-run/recording.npz --estimators my_filter.py:estimate
    """

    recording: tyro.conf.Positional[Path]
    """A recording.npz; a truth.npz beside it is used by itself."""

    truth: Path | None = None
    """The truth, if it lies elsewhere."""

    estimators: Estimators = DEFAULT_ESTIMATORS

    estimates: Overrides = field(default_factory=list)
    """Estimates that are graded as they lie there, LABEL=PATH ...: an estimate.npz, CSV, or TUM with or without the
    columns of covariances (docs/your_filter.md). Nothing of yours is run for them."""

    own_code: OwnCode = field(default_factory=OwnCode)

    association: Literal["nearest-neighbour", "jcbb"] = "nearest-neighbour"
    """How filters associate a recording without ids; jcbb is joint, and manages its map."""

    gate: float = 9.0
    """Largest squared Mahalanobis distance of an association."""

    robust: Literal["none", "gate", "student-t"] = "none"
    """How filters guard their updates against outliers (docs/outliers.md)."""

    initialisation: Literal["fis", "inverse-depth", "delayed"] = "fis"
    """How landmarks begin in filters where the recording has bearings alone."""

    reach: float = 10.0
    """How far the sensor of such a recording sees [m]; the initialisation is fitted to it."""

    out: Folder | None = None
    """Folder of the results; without it only the table is printed."""

    page: PageOptions = field(default_factory=PageOptions)

    output: Output = field(default_factory=Output)

    def __call__(self) -> int:
        """Load, grade and, if asked to, write; the exit status."""
        status = self._grade()  # what it needs of memory is free again before the page is written
        return status if write_page(self.out, METRICS, self.page) else 1

    def _grade(self) -> int:
        from slamgauge.compare.estimators.memory_check import require_room_for_estimates
        from slamgauge.compare.estimators.requests import ask
        from slamgauge.compare.scenarios.schema import INITIALISATIONS, Association
        from slamgauge.compare.storage.files import load_recording, load_truth
        from slamgauge.compare.storage.safe_names import shown
        from slamgauge.ekf.settings.association import Association as FilterAssociation
        from slamgauge.ekf.settings.robustness import Robustness
        from slamgauge.ekf.settings.validation import fitted, require

        recording = load_recording(self.recording)
        beside = self.recording.with_name("truth.npz")
        path = self.truth or (beside if beside.exists() else None)
        truth = None if path is None else load_truth(path, recording)
        title = shown(f"{self.recording.parent.resolve().name}/{self.recording.name}")
        require(FilterAssociation, "gate", self.gate)
        settings = (
            Association(method=self.association, gate=self.gate),
            fitted(INITIALISATIONS[self.initialisation], self.reach),
            Robustness(self.robust),
        )
        stored = {label: _as_it_lies(path, recording) for label, path in self._stored().items()}
        named = self.own_code.kept_apart(ask(split_names(self.estimators)))
        require_room_for_estimates(recording, len(named))
        asked = ask([*named, *ask(stored)])
        grading = Grading(asked, self.out, self.output.json, title, *settings)
        return grading.grade(truth, recording)

    def _stored(self) -> dict[str, Path]:
        """Paths of estimates by label."""
        pairs = [text.partition("=") for text in flattened(self.estimates)]
        for label, equals, path in pairs:
            if not label or not equals or not path:
                raise UserError(f"estimates {label + equals + path!r}: write LABEL=PATH, for example mine=mine.csv")
        return {label: Path(path) for label, _, path in pairs}


def _as_it_lies(path: Path, recording: Recording) -> Estimator:
    """The estimator that returns what a file holds of the recording, or fails for the reason why it holds nothing."""
    from slamgauge.compare.estimators.running import StoredEstimate
    from slamgauge.compare.estimators.user_code import OwnCodeError
    from slamgauge.compare.storage.stored_results import load_stored

    def lacking(_: Recording) -> Estimate:
        raise OwnCodeError(reason)

    try:
        return StoredEstimate(load_stored(path, recording))
    except UserError as error:
        reason = str(error)
        return lacking


@dataclass(frozen=True)
class Grading:
    """What `run` and `evaluate` share: estimators in, table and folder out."""

    asked: Sequence[Asked]
    out: Path | None
    as_json: bool
    title: str
    association: Association
    initialisation: Initialisation | None
    robust: Robustness
    scenario: str | None = None
    seed: int | None = None
    scenario_text: str | None = None

    def grade(self, truth: Truth | None, recording: Recording, informed: Recording | None = None) -> int:
        """Run the estimators, print the table and write the folder; 1 if one of them failed, else 0."""
        from slamgauge.compare.estimators.loading import load_each
        from slamgauge.compare.estimators.side_by_side import with_stand_ins
        from slamgauge.compare.scoring.comparison import compare_estimators, metrics, table
        from slamgauge.compare.storage.files import explained
        from slamgauge.compare.storage.result_files import OUTDATED, comparison_files
        from slamgauge.memory import give_back

        if not self.asked:
            raise UserError("estimators: none given; name at least one, for example --estimators ekf,batch")
        estimators, failures = load_each(self.asked, self.association, self.initialisation, FRAMES, self.robust)
        if not estimators:
            raise UserError(next(iter(failures.values())))
        files = comparison_files(estimators if recording.landmark is not None else with_stand_ins(estimators))
        with results_folder(self.out, files, METRICS, OUTDATED) as folder:
            comparison = compare_estimators(truth, recording, estimators, informed)
            give_back()
            comparison = replace(comparison, failures=failures | comparison.failures)
            content = metrics(comparison, self.scenario, self.seed, self.scenario_text)
            done = print_result(content if self.as_json else table(comparison)) and not comparison.failures
            if folder is not None and self.out is not None:
                from slamgauge.compare.scoring.comparison_files import write_comparison

                with explained(self.out, "written"):
                    write_comparison(folder, comparison, content)
                comparison, content = replace(comparison, scores={}), {}  # pictures need the estimates alone
        if self.out is not None:
            from slamgauge.compare.figures.publishing import draw_comparison

            done = draw_comparison(self.out, comparison, self.title) and done
            print(f"written to {self.out}", file=sys.stderr)
        return 0 if done else 1
