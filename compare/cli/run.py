"""Estimators on one recording: `slamgauge run` and `evaluate`."""

from __future__ import annotations

import math
import shlex
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
    Repeated,
    Sampled,
    WithPage,
    flattened,
    overridden_scenario,
    require_scenario,
    results_folder,
    split_names,
    write_page,
)
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.storage.result_files import METRICS
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from slamgauge.compare.estimators.requests import Asked
    from slamgauge.compare.scenarios.scenario import Scenario
    from slamgauge.compare.scenarios.schema import Association
    from slamgauge.ekf.settings import Initialisation, Robustness
    from slamgauge.estimate import Estimate, Estimator
    from slamgauge.recording import Recording
    from slamgauge.truth import Truth

DEFAULT_ESTIMATORS = "ekf,riekf,causal,batch"
FRAMES = 240  # maps that filters store for pictures
MOST_TWINS = 10_000


@dataclass
class Run(WithPage):
    """Simulate one run of a scenario and score estimators on it.

    For example:
      slamgauge run q1-long-dense --estimators ekf,riekf,causal,batch
      slamgauge run q2-long-dense --seed 3 --set association.gate=25 start=mean
    """

    scenario: Sampled

    seed: int = 0
    """Seed of all noise."""

    estimators: Estimators = DEFAULT_ESTIMATORS

    own_code: OwnCode = field(default_factory=OwnCode)

    set: Overrides = field(default_factory=list)

    out: Folder | None = None
    """Folder of the results. If not given: results/SCENARIO-seed-SEED."""

    def __call__(self) -> int:
        require_scenario(self.scenario)
        from slamgauge.compare.estimators.requests import ask
        from slamgauge.compare.storage.safe_names import file_name

        asked = self.own_code.isolate(ask(split_names(self.estimators)))
        scenario = overridden_scenario(self.scenario, self.set)
        out = self.out or Path("results") / f"{file_name(scenario.name)}-seed-{self.seed}"
        status = self._score(scenario, asked, out)  # its memory is free again before the page is written
        return status if write_page(out, METRICS, self.page) else 1

    def _score(self, scenario: Scenario, asked: list[Asked], out: Path) -> int:
        from slamgauge.compare.estimators.memory_check import require_room_for_estimates
        from slamgauge.compare.scenarios.scenario import scenario_text
        from slamgauge.compare.scenarios.simulation import simulate_informed
        from slamgauge.compare.storage.staged_folder import require_ours

        require_ours(out)
        truth, recording, informed = simulate_informed(scenario, self.seed)
        require_room_for_estimates(informed, asked)
        settings = (scenario.association, scenario.initialisation_settings, scenario.robustness)
        origin = (scenario.name, self.seed, scenario_text(scenario))
        scoring = Scoring(asked, out, self.output, *settings, *origin, study=self._study_command())
        return scoring.score(truth, recording, informed)

    def _study_command(self) -> str:
        """Return the command of many runs with the same scenario, settings and estimators."""
        from slamgauge.compare.storage.safe_names import shown

        words = ["slamgauge", "study", self.scenario, "--runs", "100"]
        words += ["--estimators", self.estimators] if self.estimators != DEFAULT_ESTIMATORS else []
        words += ["--set", *flattened(self.set)] if self.set else []
        return shown(shlex.join(words))


@dataclass(frozen=True)
class Tests:
    """Tests that need no ground truth."""

    twins: int = 0
    """Simulated twins of the consistency test without ground truth, for example 99 (docs/no_ground_truth.md)."""


@dataclass(frozen=True)
class StoredOptions:
    """How stored trajectories are read and scored."""

    covariance_frame: Literal["world", "body"] = "world"
    """Frame of the covariances of stored trajectories; GTSAM's Marginals are in the body frame."""

    time_offset: float = 0.0
    """Added to the stamps of stored trajectories [s]."""

    max_gap: float = 1.0
    """Longest time without a pose of a stored trajectory [s]: larger for keyframes."""

    align: Literal["none", "se2"] = "none"
    """se2: score each stored estimate a second time, as LABEL-aligned, moved and turned to fit the true positions."""


@dataclass
class Evaluate(WithPage):
    """Score estimators, your own among them, on a stored recording.

    If the truth has associations, causal and batch use them. Otherwise causal and batch use the associations of the
    first estimator that makes any (causal@ekf). All estimators assume the noise of the recording.

    For example:
      slamgauge evaluate first-run/recording.npz --estimators my_filter.py:estimate
    """

    recording: tyro.conf.Positional[Path]
    """A recording.npz. A truth.npz in its folder is read too."""

    truth: Path | None = None
    """The truth, if it is in another place."""

    estimators: Estimators = DEFAULT_ESTIMATORS

    estimates: Repeated = field(default_factory=list)
    """Stored estimates, LABEL=PATH ...: npz, CSV, TUM or BAG:/TOPIC (docs/your_filter.md). No code of yours runs."""

    stored: StoredOptions = field(default_factory=StoredOptions)

    own_code: OwnCode = field(default_factory=OwnCode)

    set: Repeated = field(default_factory=list)
    """How filters associate a recording without ids, by keys of scenarios: association.method=jcbb association.gate=16.
    By default nearest-neighbour with a gate of 9; jcbb associates jointly and manages its map."""

    robust: Literal["none", "gate", "student-t"] = "none"
    """How filters protect their updates from outliers (docs/association.md)."""

    initialisation: Literal["fis", "delayed"] = "fis"
    """How filters add landmarks if the recording is bearing-only."""

    reach: float = 10.0
    """Largest range of the sensor of a bearing-only recording [m]. The initialisation is fitted to it."""

    test: Tests = field(default_factory=Tests)

    out: Folder | None = None
    """Folder of the results. Without it the table is only printed."""

    def __call__(self) -> int:
        status = self._score()  # its memory is free again before the page is written
        return status if write_page(self.out, METRICS, self.page) else 1

    def _score(self) -> int:
        from slamgauge.compare.estimators.memory_check import require_room_for_estimates
        from slamgauge.compare.estimators.requests import ask
        from slamgauge.compare.scenarios.scenario import stored_association
        from slamgauge.compare.scenarios.schema import INITIALISATIONS
        from slamgauge.compare.storage.files import load_recording, load_truth
        from slamgauge.ekf.setting_rules import fitted
        from slamgauge.ekf.settings import Robustness

        recording = load_recording(self.recording)
        beside = self.recording.with_name("truth.npz")
        path = self.truth or (beside if beside.exists() else None)
        truth = None if path is None else load_truth(path, recording)
        settings = (
            stored_association(flattened(self.set)),
            fitted(INITIALISATIONS[self.initialisation], self.reach),
            Robustness(self.robust),
        )
        stored = _stored_estimators(self._stored(), recording, truth, self.stored)
        named = self.own_code.isolate(ask(split_names(self.estimators)))
        require_room_for_estimates(recording, named)
        if not 0 <= self.test.twins <= MOST_TWINS:
            raise UserError(f"twins: {self.test.twins} is out of range; give 0 to {MOST_TWINS}")
        asked = ask([*named, *ask(stored)])
        scoring = Scoring(asked, self.out, self.output, *settings, test=self.test)
        return scoring.score(truth, recording)

    def _stored(self) -> dict[str, Path]:
        """Return the paths of stored estimates by label."""
        pairs = [text.partition("=") for text in flattened(self.estimates)]
        for label, equals, path in pairs:
            if not label or not equals or not path:
                raise UserError(f"estimates {label + equals + path!r}: write LABEL=PATH, for example mine=mine.csv")
        return {label: Path(path) for label, _, path in pairs}


def _stored_estimators(
    paths: dict[str, Path], recording: Recording, truth: Truth | None, options: StoredOptions
) -> dict[str, Estimator]:
    """Return estimators of the estimates in files by label; one that cannot be read raises the reason when it runs."""
    from slamgauge.compare.estimators.stored_trajectory import load_stored
    from slamgauge.compare.estimators.user_errors import UserCodeError
    from slamgauge.compare.scoring.alignment import aligned
    from slamgauge.compare.scoring.covariance_frame import frame_doubt, in_world_frame
    from slamgauge.notices import tell_once

    def unreadable(reason: str) -> Estimator:
        def refuse(_: Recording) -> Estimate:
            raise UserCodeError(reason)

        return refuse

    if not math.isfinite(options.time_offset):
        raise UserError(f"time-offset: {options.time_offset:g} is not a time; give seconds")
    if not options.max_gap > 0.0:
        raise UserError(f"max-gap: {options.max_gap:g} s is no time; give seconds > 0")
    if options.align == "se2" and (truth is None or truth.poses is None):
        raise UserError("align: se2 needs true positions; give --truth, or leave this option out")
    found: dict[str, Estimator] = {}
    for label, path in paths.items():
        try:
            stored = load_stored(path, recording, options.time_offset, options.max_gap)
            if options.covariance_frame == "body":
                stored = in_world_frame(stored)
            elif doubt := frame_doubt(label, stored, truth, recording):
                tell_once(doubt)
            found[label] = stored
            if options.align == "se2" and truth is not None:
                found[f"{label}-aligned"] = aligned(f"{label}-aligned", stored, truth, recording)
        except UserError as error:
            found[label] = unreadable(str(error))
    return found


@dataclass(frozen=True)
class Scoring:
    """The part that `run` and `evaluate` share: from requested estimators to table and folder."""

    asked: Sequence[Asked]
    out: Path | None
    output: Output
    association: Association
    initialisation: Initialisation | None
    robust: Robustness
    scenario: str | None = None
    seed: int | None = None
    scenario_text: str | None = None
    test: Tests = field(default_factory=Tests)
    study: str = ""  # command of many runs, if the recording is simulated

    def score(self, truth: Truth | None, recording: Recording, informed: Recording | None = None) -> int:
        """Run the estimators, print the table and write the folder; return 1 if an estimator failed, else 0."""
        from slamgauge.compare.estimators.loading import load_each
        from slamgauge.compare.estimators.running import with_stand_ins
        from slamgauge.compare.scoring.comparison import (
            compare_estimators,
            metrics,
            table,
            tested_without_truth,
            write_comparison,
        )
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
            comparison = replace(comparison, failures=failures | comparison.failures, study=self.study)
            if self.test.twins:
                comparison = tested_without_truth(comparison, self.test.twins)
            content = metrics(comparison, self.scenario, self.seed, self.scenario_text)
            self.output.show(content, table(comparison))
            done = not comparison.failures
            if folder is not None and self.out is not None:
                with explained(self.out, "written"):
                    write_comparison(folder, comparison, content)
        if self.out is not None:
            from slamgauge.compare.figures.publishing import draw_stored

            del comparison  # the figures are drawn from the folder
            done = draw_stored(self.out, METRICS) and done
            print(f"written to {self.out}", file=sys.stderr)
        return 0 if done else 1
