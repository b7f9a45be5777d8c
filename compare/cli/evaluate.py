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
from slamgauge.compare.estimators import requests, stored_trajectory
from slamgauge.compare.scenarios import scenario as scenarios
from slamgauge.compare.scenarios import schema
from slamgauge.compare.scoring import own_stamps
from slamgauge.compare.storage import files
from slamgauge.compare.storage.result_files import TRUTH
from slamgauge.ekf import setting_rules
from slamgauge.ekf import settings as filters
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from slamgauge.estimate import Estimator
    from slamgauge.recording import Recording
    from slamgauge.truth import Truth


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

    def read(self, label: str, path: Path, recording: Recording, truth: Truth | None) -> dict[str, Estimator]:
        """Return the estimate in a file, and the aligned one if that is requested, by their labels."""
        stored = stored_trajectory.load_stored(path, recording, self.time_offset, self.max_gap)
        if self.covariance_frame == "body":
            stored = own_stamps.in_world_frame(stored)
        elif doubt := own_stamps.frame_doubt(label, stored, truth, recording):
            notices.tell_once(doubt)
        if self.align == "none" or truth is None:
            return {label: stored}
        name = f"{label}-aligned"
        return {label: stored, name: own_stamps.aligned(name, stored, truth, recording)}


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
        if not math.isfinite(self.stored.time_offset) or not self.stored.max_gap > 0.0:
            what = f"time-offset and max-gap: {self.stored.time_offset:g} s and {self.stored.max_gap:g} s"
            raise UserError(f"{what} are not a time and a gap above 0; give seconds")
        if self.stored.align == "se2" and (truth is None or truth.poses is None):
            raise UserError("align: se2 needs true positions; give --truth, or leave this option out")
        stored, failures = dict[str, "Estimator"](), dict[str, str]()
        for text in flattened(self.estimates):
            label, _, place = text.partition("=")
            if not label or not place:
                raise UserError(f"estimates {text!r}: write LABEL=PATH, for example mine=mine.csv")
            try:
                stored |= self.stored.read(label, Path(place), recording, truth)
            except UserError as error:
                failures[label] = f"estimator {label}: {error}"
        asked = requests.ask([*self.own_code.ask(self.estimators), *requests.ask(stored)])
        return score(self, self.out, Data(truth, recording, twins=self.twins, failures=failures), asked, settings)
