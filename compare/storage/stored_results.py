"""Read the folder of results that `slamgauge run` or `evaluate --out` wrote."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from slamgauge.compare.storage.files import load_estimate, load_recording, load_truth, read_json
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth, require_same_run


class Results(NamedTuple):
    """Results of `slamgauge run` or `evaluate --out`; estimates by name, in the order of the command."""

    title: str
    truth: Truth | None
    recording: Recording
    estimates: dict[str, Estimate]


def load_results(folder: Path) -> Results:
    """Read the results in a folder.

    Raises:
        UserError: If the folder has no results, or its files belong to different runs.
    """
    path = folder / "metrics.json"
    if not path.is_file():
        raise UserError(
            f"{folder}: not a folder of results, it has no metrics.json; "
            "give one that `slamgauge run` or `slamgauge evaluate --out` has written"
        )
    metrics = read_json(path, "run")
    try:
        names, scenario, seed = list(metrics["estimators"]), metrics["scenario"], metrics["seed"]
    except (TypeError, KeyError):
        raise UserError(f"{path}: not what `slamgauge run` writes; run it again") from None
    if not names:
        raise UserError(f"{path}: contains no estimators; run the command again with at least one")
    recording = load_recording(folder / "recording.npz")
    truth = load_truth(folder / "truth.npz", recording) if (folder / "truth.npz").exists() else None
    require_same_run(truth, recording)
    estimates = {name: load_estimate(folder / "estimates" / f"{name}.npz", recording) for name in names}
    for name, estimate in estimates.items():
        if len(estimate.poses) != recording.steps + 1:
            raise UserError(
                f"{folder / 'estimates' / name}.npz: {len(estimate.poses)} poses, "
                f"but the recording in this folder needs {recording.steps + 1}; run the command again"
            )
    title = shown(folder.resolve().name if scenario is None else f"{scenario}, seed {seed}")
    return Results(title, truth, recording, estimates)
