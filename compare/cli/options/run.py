"""Options of `slamgauge run` and `evaluate`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

from slamgauge.compare.cli.options.shared import Estimators, Folder, OfScenario, Overrides, OwnCode, Repeated, WithPage

DEFAULT_ESTIMATORS = "ekf,riekf,causal,batch"


@dataclass
class Run(OfScenario, WithPage):
    """Simulate one run of a scenario and score estimators on it.

    For example:
      slamgauge run q1-long-dense --estimators ekf,riekf,causal,batch
      slamgauge run q2-long-dense --seed 3 --set association.gate=25 start=mean
    """

    seed: int = 0
    """Seed of all noise."""

    estimators: Estimators = DEFAULT_ESTIMATORS

    own_code: OwnCode = field(default_factory=OwnCode)

    set: Overrides = field(default_factory=list)

    out: Folder | None = None
    """Folder of the results. If not given: results/SCENARIO-seed-SEED."""


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
