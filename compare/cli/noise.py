"""The noise of a recording: `slamgauge noise`."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from slamgauge.compare.cli.common import WithPage, staged
from slamgauge.compare.noise import estimation, noise_json, tables
from slamgauge.compare.scoring import comparison
from slamgauge.compare.storage import files, staged_folder
from slamgauge.compare.storage.result_files import NOISE


@dataclass
class Command(WithPage):
    """Estimate the noise of a recording from its measurements, with intervals, outliers and a diagnosis.

    For example:
      slamgauge noise first-run/recording.npz --systematic

    Attributes:
        recording: A recording.npz, with ranges and bearings or positions. If it has no ids, landmarks are associated
            jointly.
        out: Folder of noise.json, noise.png and noise.svg. Without it they are not written.
        write: Write the recording with the estimated noise, and without its systematic errors, to this npz file.
        systematic: Also estimate systematic errors: odometry scale, turn per metre, offsets of range and bearing.
        heading: The direction that the start heading describes, if --systematic finds a bearing offset. The other is
            rotated.
    """

    recording: tyro.conf.Positional[Path]
    out: Path | None = None
    write: Path | None = None
    systematic: bool = False
    heading: Literal["sensor", "odometry"] = "sensor"

    def run(self) -> int:
        recording, write = files.load_recording(self.recording), self.write
        stage_of_write = nullcontext() if write is None else staged_folder.staged_files(write.parent, [write.name])
        with staged(self.out, NOISE) as folder, stage_of_write as stage:
            noise = estimation.find_noise(recording, systematic=self.systematic, heading=self.heading)
            content = noise_json.noise_json(noise) | {"digest": comparison.digest(recording)}
            self.output.show(content, tables.noise_page(content), folder and folder / NOISE)
            if write is not None and stage is not None:
                files.save(stage / write.name, noise.tuned)
        if write is not None:
            print(f"written to {write}", file=sys.stderr)
        return self.finish(self.out, NOISE)
