"""Estimators on a stored recording: `slamgauge evaluate`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from slamgauge import notices
from slamgauge.compare.cli.common import Estimators, OwnCode, Repeated, WithPage, flattened
from slamgauge.compare.cli.run import DEFAULT_ESTIMATORS, Data, score
from slamgauge.compare.estimators import requests, stored_trajectory, user_errors
from slamgauge.compare.scenarios import scenario as scenarios
from slamgauge.compare.scenarios import schema
from slamgauge.compare.scoring import own_stamps
from slamgauge.compare.storage import files
from slamgauge.compare.storage.result_files import TRUTH
from slamgauge.ekf import setting_rules
from slamgauge.ekf import settings as filters
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from slamgauge.estimate import Estimate, Estimator
    from slamgauge.recording import Recording
    from slamgauge.truth import Truth

MOST_TWINS = 10_000


@dataclass(frozen=True)
class Stored:
    """How stored trajectories are read and scored.

    Attributes:
        covariance_frame: Frame of the covariances of stored trajectories; GTSAM's Marginals are in the body frame.
        time_offset: Added to the stamps of stored trajectories [s].
        max_gap: Longest time without a pose of a stored trajectory [s]: larger for keyframes.
        align: se2: score each stored estimate a second time, as LABEL-aligned, moved and turned to fit the true
            positions.
    """

    covariance_frame: Literal["world", "body"] = "world"
    time_offset: float = 0.0
    max_gap: float = 1.0
    align: Literal["none", "se2"] = "none"

    def estimators(self, paths: dict[str, Path], recording: Recording, truth: Truth | None) -> dict[str, Estimator]:
        """Return estimators of the estimates in files by label; one that cannot be read raises the reason when run."""
        if not math.isfinite(self.time_offset):
            raise UserError(f"time-offset: {self.time_offset:g} is not a time; give seconds")
        if not self.max_gap > 0.0:
            raise UserError(f"max-gap: {self.max_gap:g} s is not above 0; give seconds > 0")
        if self.align == "se2" and (truth is None or truth.poses is None):
            raise UserError("align: se2 needs true positions; give --truth, or leave this option out")
        found: dict[str, Estimator] = {}
        for label, path in paths.items():
            try:
                stored = stored_trajectory.load_stored(path, recording, self.time_offset, self.max_gap)
                if self.covariance_frame == "body":
                    stored = own_stamps.in_world_frame(stored)
                elif doubt := own_stamps.frame_doubt(label, stored, truth, recording):
                    notices.tell_once(doubt)
                found[label] = stored
                if self.align == "se2" and truth is not None:
                    name = f"{label}-aligned"
                    found[name] = own_stamps.aligned(name, stored, truth, recording)
            except UserError as error:
                found[label] = _unreadable(str(error))
        return found


def _unreadable(reason: str) -> Estimator:
    def refuse(_: Recording) -> Estimate:
        raise user_errors.UserCodeError(reason)

    return refuse


@dataclass
class Command(WithPage):
    """Score estimators, your own among them, on a stored recording.

    If the truth has associations, causal and batch use them. Otherwise causal and batch use the associations of the
    first estimator that makes any (causal@ekf). All estimators assume the noise of the recording.

    For example:
      slamgauge evaluate first-run/recording.npz --estimators my_filter.py:estimate

    Attributes:
        recording: A recording.npz. A truth.npz in its folder is read too.
        truth: The truth, if it is in another place.
        estimates: Stored estimates, LABEL=PATH ...: npz, CSV, TUM or BAG:/TOPIC (docs/your_filter.md). No code of
            yours runs.
        set: How filters associate a recording without ids, by keys of scenarios: association.method=jcbb
            association.gate=16. By default nearest-neighbour with a gate of 9; jcbb associates jointly and manages its
            map.
        robust: How filters protect their updates from outliers (docs/association.md).
        initialisation: How filters add landmarks if the recording is bearing-only.
        reach: Largest range of the sensor of a bearing-only recording [m]. The initialisation is fitted to it.
        twins: Simulated twins of the consistency test without ground truth, for example 99 (docs/no_ground_truth.md).
        out: Folder of the results. Without it the table is only printed.
    """

    recording: tyro.conf.Positional[Path]
    truth: Path | None = None
    estimators: Estimators = DEFAULT_ESTIMATORS
    estimates: Repeated = field(default_factory=list)
    stored: Stored = field(default_factory=Stored)
    own_code: OwnCode = field(default_factory=OwnCode)
    set: Repeated = field(default_factory=list)
    robust: Literal["none", "gate", "student-t"] = "none"
    initialisation: Literal["fis", "delayed"] = "fis"
    reach: float = 10.0
    twins: int = 0
    out: Path | None = None

    def run(self) -> int:
        recording = files.load_recording(self.recording)
        beside = self.recording.with_name(TRUTH)
        path = self.truth or (beside if beside.exists() else None)
        truth = None if path is None else files.load_truth(path)
        settings = (
            scenarios.stored_association(flattened(self.set)),
            setting_rules.fitted(schema.INITIALISATIONS[self.initialisation], self.reach),
            filters.Robustness(self.robust),
        )
        pairs = [text.partition("=") for text in flattened(self.estimates)]
        for label, equals, stored in pairs:
            if not label or not equals or not stored:
                raise UserError(f"estimates {label + equals + stored!r}: write LABEL=PATH, for example mine=mine.csv")
        paths = {label: Path(stored) for label, _, stored in pairs}
        named = self.own_code.ask(self.estimators)
        asked = requests.ask([*named, *requests.ask(self.stored.estimators(paths, recording, truth))])
        if not 0 <= self.twins <= MOST_TWINS:
            raise UserError(f"twins: {self.twins} is out of range; give 0 to {MOST_TWINS}")
        return score(self, self.out, Data(truth, recording, twins=self.twins), asked, settings)
