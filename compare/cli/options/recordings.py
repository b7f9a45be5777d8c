"""Options of the commands on one recording: `slamgauge noise` and `twin`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from slamgauge.compare.cli.options.shared import Folder, Options, WithPage, named_after


@dataclass
class Noise(WithPage):
    """Estimate the noise of a recording from its measurements, with intervals, outliers and a diagnosis.

    For example:
      slamgauge noise first-run/recording.npz --systematic
    """

    recording: tyro.conf.Positional[Path]
    """A recording.npz, with ranges and bearings or positions. If it has no ids, landmarks are associated jointly."""

    out: Folder | None = None
    """Folder of noise.json, noise.png and noise.svg. Without it they are not written."""

    write: Folder | None = None
    """Write the recording with the estimated noise, and without its systematic errors, to this npz file."""

    systematic: bool = False
    """Also estimate systematic errors: odometry scale, turn per metre, offsets of range and bearing."""

    heading: Literal["sensor", "odometry"] = "sensor"
    """The direction that the start heading describes, if --systematic finds a bearing offset. The other is rotated."""


@dataclass
class Twin(Options):
    """Make a scenario of a recording, with its estimated path and map, its observations, noise and stamps.

    Every command takes the scenario: study, budget and sweeps then show what filters do at your site, without ground
    truth.

    For example:
      slamgauge twin mine/recording.npz --out twin
      slamgauge study twin/twin.toml --runs 20
    """

    recording: tyro.conf.Positional[Path]
    """A recording.npz. If it has no ids, landmarks are associated jointly."""

    out: Folder = Path("results/twin-NAME")
    """Folder of twin.toml and of the CSV files that it names."""

    def __post_init__(self) -> None:
        self.out = named_after(self.out, self.recording.resolve().parent)
