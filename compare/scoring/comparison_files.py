"""The files of a comparison, all but its pictures: what draws these takes room, and is not loaded for them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from slamgauge.compare.scoring.comparison import Comparison
from slamgauge.compare.storage.files import save, write_json, write_tum
from slamgauge.compare.storage.result_files import METRICS, RECORDING, TRUTH


def write_comparison(folder: Path, comparison: Comparison, content: dict[str, Any]) -> None:
    """Write recording, truth, estimates, TUM trajectories and metrics into an existing, empty folder."""
    recording, truth = comparison.recording, comparison.truth
    save(folder / RECORDING, recording)
    if truth is not None:
        save(folder / TRUTH, truth)
    (folder / "estimates").mkdir()
    (folder / "trajectories").mkdir()
    for name, estimate in comparison.estimates.items():
        save(folder / "estimates" / f"{name}.npz", estimate)
        write_tum(folder / "trajectories" / f"{name}.tum", recording.stamps, estimate.poses)
    if truth is not None and truth.poses is not None:
        write_tum(folder / "trajectories" / "truth.tum", recording.stamps, truth.poses)
    write_json(folder / METRICS, content)
