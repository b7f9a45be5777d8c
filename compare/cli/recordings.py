"""Commands on one recording: its noise (`slamgauge noise`) and a scenario made of it (`slamgauge twin`)."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from slamgauge.compare.cli.options import Folder, WithPage, named_after, results_folder, write_page
from slamgauge.compare.cli.terminal import Output
from slamgauge.errors import UserError


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

    def __call__(self) -> int:
        from slamgauge.compare.noise.estimation import find_noise
        from slamgauge.compare.noise.noise_json import noise_json
        from slamgauge.compare.noise.tables import noise_page
        from slamgauge.compare.scoring.comparison import digest
        from slamgauge.compare.storage.files import load_recording, save, write_json
        from slamgauge.compare.storage.result_files import NOISE, NOISE_FILES
        from slamgauge.compare.storage.staged_folder import staged_files

        recording = load_recording(self.recording)
        if self.write is not None and self.write.resolve() == self.recording.resolve():
            raise UserError(f"{self.write}: is the recording itself; give another --write")
        staged = nullcontext() if self.write is None else staged_files(self.write.parent, [self.write.name])
        with staged as parent, results_folder(self.out, NOISE_FILES, last=NOISE) as folder:
            noise = find_noise(recording, systematic=self.systematic, heading=self.heading)
            content = noise_json(noise) | {"digest": digest(recording)}
            self.output.show(content, noise_page(content))
            if folder is not None:
                write_json(folder / NOISE, content)
            if self.write is not None and parent is not None:
                save(parent / self.write.name, noise.tuned)
        done = True
        if self.out is not None:
            from slamgauge.compare.figures.publishing import draw_stored

            done = draw_stored(self.out, NOISE)
        for place in filter(None, (self.out, self.write)):
            print(f"written to {place}", file=sys.stderr)
        return 0 if write_page(self.out, NOISE, self.page) and done else 1


@dataclass
class Twin:
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

    def __call__(self) -> None:
        from slamgauge.compare.estimators.registry import HINDSIGHT, REGISTRY
        from slamgauge.compare.scoring.optimum_notes import fit_of_the_model
        from slamgauge.compare.scoring.text_page import Page
        from slamgauge.compare.storage.files import load_recording
        from slamgauge.compare.storage.result_files import TWIN, TWIN_FILES
        from slamgauge.compare.storage.safe_names import shown
        from slamgauge.compare.storage.staged_folder import require_ours, staged_folder
        from slamgauge.compare.studies.twin import ASSOCIATES, make_twin, write_twin

        recording = load_recording(self.recording)
        require_ours(self.out)
        twin = make_twin(recording)
        with staged_folder(self.out, TWIN_FILES, last=TWIN) as folder:
            write_twin(folder, twin, shown(f"{self.recording.parent.resolve().name}/{self.recording.name}"))
        notes: list[str] = []
        if not twin.has_ids:
            notes.append(f"no ids: associated by {ASSOCIATES} with jcbb, which may be wrong")
        if twin.left_out:
            notes.append(f"{twin.left_out} observations dropped: they have no association or no landmark position")
        fit = fit_of_the_model(REGISTRY[HINDSIGHT].title, twin.optimum)
        if fit is not None:
            notes.append(Output().laid_out(Page((fit,))))
        counts = f"{twin.recording.steps} steps, {len(twin.optimum.landmark_ids)} landmarks"
        written = f"{counts}, {len(twin.landmark)} observations: written to {self.out / TWIN}"
        print(*notes, written, sep="\n", file=sys.stderr)
