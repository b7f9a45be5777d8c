"""`slamgauge noise`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

from slamgauge.compare.cli.options import Folder, print_result, results_folder
from slamgauge.compare.cli.pages import PageOptions, write_page
from slamgauge.compare.cli.terminal import Output
from slamgauge.errors import UserError

REMEDY = "move it away or give another --write"


@dataclass
class Noise:
    """Which noise the measurements of a recording support, with intervals, outliers and a diagnosis.

    For example:
      slamgauge noise first-run/recording.npz --systematic
    """

    recording: tyro.conf.Positional[Path]
    """recording.npz, with ranges and bearings or positions; without ids, landmarks are associated jointly."""

    out: Folder | None = None
    """Folder for noise.json, noise.png and noise.svg."""

    write: Folder | None = None
    """Write the recording with the noise found, and without the systematic errors, to this npz file."""

    systematic: bool = False
    """Look for systematic errors, too: odometry scale, turn per metre, offsets of range and bearing."""

    heading: Literal["sensor", "odometry"] = "sensor"
    """Whose straight ahead the start's heading is, where --systematic finds a bearing offset: the other is turned."""

    page: PageOptions = field(default_factory=PageOptions)

    output: Output = field(default_factory=Output)

    def __call__(self) -> int:
        """Find, print and, if asked to, write; the exit status."""
        from slamgauge.compare.noise.estimation import find_noise
        from slamgauge.compare.noise.noise_json import noise_json
        from slamgauge.compare.noise.report_text import noise_table
        from slamgauge.compare.scoring.comparison import digest
        from slamgauge.compare.storage.files import load_recording, save, write_json
        from slamgauge.compare.storage.result_files import NOISE, NOISE_FILES
        from slamgauge.compare.storage.staged_folder import staged_folder

        recording = load_recording(self.recording)
        if self.write is not None:
            self._require_free(self.write)
        with results_folder(self.out, NOISE_FILES, last=NOISE) as folder:
            noise = find_noise(recording, systematic=self.systematic, heading=self.heading)
            content = noise_json(noise) | {"digest": digest(recording)}
            done = print_result(content if self.output.json else noise_table(noise))
            if folder is not None:
                write_json(folder / NOISE, content)
        if self.write is not None:
            with staged_folder(self.write.parent, [self.write.name], self.write.name, remedy=REMEDY) as folder:
                save(folder / self.write.name, noise.tuned)
        if self.out is not None:
            from slamgauge.compare.figures.publishing import draw_noise

            done = draw_noise(self.out, content) and done
        for place in (self.out, self.write):
            if place is not None:
                print(f"written to {place}", file=sys.stderr)
        explained = write_page(self.out, NOISE, self.page)
        return 0 if done and explained else 1

    def _require_free(self, write: Path) -> None:
        """Refuse a place for the recording where something else is, before work begins."""
        from slamgauge.compare.storage.manifest import require_free

        if write.resolve() == self.recording.resolve():
            raise UserError(f"{write}: is the recording itself; give another --write")
        require_free(write.parent, [write.name], REMEDY)
