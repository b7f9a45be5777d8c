"""A scenario made of a recording: `slamgauge twin`."""

from __future__ import annotations

import sys

from slamgauge.compare.cli.options.recordings import Twin
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators.registry import HINDSIGHT, REGISTRY
from slamgauge.compare.scoring.optimum_notes import fit_of_the_model
from slamgauge.compare.scoring.text_page import Page
from slamgauge.compare.storage.files import load_recording
from slamgauge.compare.storage.result_files import TWIN
from slamgauge.compare.storage.safe_names import shown
from slamgauge.compare.storage.staged_folder import require_ours, staged_folder
from slamgauge.compare.studies.twin import ASSOCIATES, make_twin, write_twin


def run(command: Twin) -> None:
    """Run the command; return the exit status."""
    recording = load_recording(command.recording)
    require_ours(command.out)
    twin = make_twin(recording)
    with staged_folder(command.out, TWIN) as folder:
        write_twin(folder, twin, shown(f"{command.recording.parent.resolve().name}/{command.recording.name}"))
    notes: list[str] = []
    if not twin.has_ids:
        notes.append(f"no ids: associated by {ASSOCIATES} with jcbb, which may be wrong")
    if twin.left_out:
        notes.append(f"{twin.left_out} observations dropped: they have no association or no landmark position")
    fit = fit_of_the_model(REGISTRY[HINDSIGHT].title, twin.optimum)
    if fit is not None:
        notes.append(Output().laid_out(Page((fit,))))
    counts = f"{twin.recording.steps} steps, {len(twin.optimum.landmark_ids)} landmarks"
    written = f"{counts}, {len(twin.landmark)} observations: written to {command.out / TWIN}"
    print(*notes, written, sep="\n", file=sys.stderr)
