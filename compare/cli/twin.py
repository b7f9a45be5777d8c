"""The twin of a log: `slamgauge twin`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from slamgauge.compare.cli.options import Folder, named_after
from slamgauge.compare.cli.terminal import laid_out


@dataclass
class MakeTwin:
    """Make a scenario of a recording: its optimum's path and map, its own sightings, noise and stamps.

    All commands take the scenario: study, budget and sweeps then tell of your own site, without ground truth.

    For example:
      slamgauge twin mine/recording.npz --out twin
      slamgauge study twin/twin.toml --runs 20
    """

    recording: tyro.conf.Positional[Path]
    """A recording.npz; one without ids is associated jointly first."""

    out: Folder = Path("results/twin-NAME")
    """Folder of twin.toml and of the CSV files that it names."""

    def __post_init__(self) -> None:
        self.out = named_after(self.out, self.recording.resolve().parent)

    def __call__(self) -> None:
        """Load, solve and write."""
        from slamgauge.compare.estimators.registry import HINDSIGHT, REGISTRY
        from slamgauge.compare.scoring.optimum_notes import fit_of_the_model
        from slamgauge.compare.scoring.text_page import Page
        from slamgauge.compare.storage.files import load_recording
        from slamgauge.compare.storage.manifest import require_free
        from slamgauge.compare.storage.result_files import TWIN, TWIN_FILES
        from slamgauge.compare.storage.safe_names import shown
        from slamgauge.compare.storage.staged_folder import staged_folder
        from slamgauge.compare.studies.twin import ASSOCIATES, make_twin, write_twin

        recording = load_recording(self.recording)
        require_free(self.out, TWIN_FILES)
        twin = make_twin(recording)
        with staged_folder(self.out, TWIN_FILES, last=TWIN) as folder:
            write_twin(folder, twin, shown(f"{self.recording.parent.resolve().name}/{self.recording.name}"))
        if not twin.has_ids:
            print(f"no ids: associated by {ASSOCIATES} with jcbb, right or wrong", file=sys.stderr)
        if twin.left_out:
            print(f"{twin.left_out} observations are left out, which nobody places or associates", file=sys.stderr)
        fit = fit_of_the_model(REGISTRY[HINDSIGHT].title, twin.optimum)
        if fit is not None:
            print(laid_out(Page((fit,))), file=sys.stderr)
        print(
            f"{twin.recording.steps} steps, {len(twin.optimum.landmark_ids)} landmarks, "
            f"{len(twin.landmark)} sightings: written to {self.out / TWIN}",
            file=sys.stderr,
        )
