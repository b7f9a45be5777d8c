"""A scenario made of a recording: `slamgauge twin`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from slamgauge.compare.cli.common import results_of
from slamgauge.compare.estimators.registry import HINDSIGHT, REGISTRY
from slamgauge.compare.scoring import optimum_notes
from slamgauge.compare.storage import files, staged_folder
from slamgauge.compare.storage.result_files import TWIN, shown
from slamgauge.compare.studies import twin as twins


@dataclass
class Command:
    """Make a scenario of a recording, with its estimated path and map, its observations, noise and stamps.

    Every command takes the scenario: study, budget and sweeps then show what filters do at your site, without ground
    truth.

    For example:
      slamgauge twin mine/recording.npz --out twin
      slamgauge study twin/twin.toml --runs 20

    Attributes:
        recording: A recording.npz. If it has no ids, landmarks are associated jointly.
        out: Folder of twin.toml and of the CSV files that it names. If not given: results/twin-FOLDER.
    """

    recording: tyro.conf.Positional[Path]
    out: Path | None = None

    def run(self) -> int:
        folder = self.recording.resolve().parent
        out = self.out or results_of("twin", folder)
        with staged_folder.staged_folder(out, TWIN) as stage:
            twin = twins.make_twin(files.load_recording(self.recording))
            twins.write_twin(stage, twin, shown(f"{folder.name}/{self.recording.name}"))
        notes: list[str] = []
        if not twin.has_ids:
            notes.append(f"no ids: associated by {twins.ASSOCIATES} with jcbb, which may be wrong")
        if twin.left_out:
            notes.append(f"{twin.left_out} observations dropped: they have no association or no landmark position")
        notes += filter(None, [optimum_notes.fit_of_the_model(REGISTRY[HINDSIGHT].title, twin.optimum)])
        counts = f"{twin.recording.steps} steps, {len(twin.optimum.landmark_ids)} landmarks"
        written = f"{counts}, {len(twin.landmark)} observations: written to {out / TWIN}"
        print(*notes, written, sep="\n", file=sys.stderr)
        return 0
