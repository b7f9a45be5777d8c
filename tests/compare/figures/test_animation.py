"""`slamgauge animate`: shown estimators, the GIF, and refusals of damaged folders."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slamgauge.compare.cli.main import main
from slamgauge.compare.figures.frames import animate, chosen
from slamgauge.compare.storage.files import save
from slamgauge.compare.storage.staged_folder import begin_folder
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.truth import Truth
from tests.reference.example_rays import STEPS, estimate_with_rays, half_loop

pytestmark = pytest.mark.slow

WITH_RAYS = estimate_with_rays()
NO_HISTORY = replace(WITH_RAYS, rays=None, history=None)
SMOOTHED = replace(NO_HISTORY, kind="smoothed")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Results of `ekf` with rays, `causal` without a history, and `batch`."""
    (truth, recording), folder = half_loop(), tmp_path / "results"
    begin_folder(folder)
    (folder / "estimates").mkdir()
    save(folder / "recording.npz", recording)
    save(folder / "truth.npz", truth)
    estimates = {"ekf": WITH_RAYS, "causal": NO_HISTORY, "batch": SMOOTHED}
    for name, estimate in estimates.items():
        save(folder / "estimates" / f"{name}.npz", estimate)
    metrics = {"scenario": "q4", "seed": 7, "estimators": dict.fromkeys(estimates)}
    (folder / "metrics.json").write_text(json.dumps(metrics), encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("names", "asked", "shown", "mapped"),
    [
        ("dead-reckoning,ekf,causal,batch", "", "ekf,causal,batch", "ekf,causal"),
        ("ekf,riekf,iekf,causal,batch", "", "ekf,batch", "ekf"),
        ("a,b,c,d,batch", "d,batch,b,c", "d,batch,b,c", "d,batch,b,c"),
        ("batch", "", "batch", "batch"),
        ("dead-reckoning", "", "dead-reckoning", "dead-reckoning"),
    ],
)
def test_estimators_shown_with_paths_and_maps(names: str, asked: str, shown: str, mapped: str):
    estimates = {name: SMOOTHED if name == "batch" else NO_HISTORY for name in names.split(",")}
    found = chosen(estimates, asked.split(",") if asked else [])
    assert [",".join(each) for each in found] == [shown, mapped]


def test_the_gif_has_the_frames_the_length_and_the_size(folder: Path):
    assert main(["animate", str(folder), "--seconds", "2", "--fps", "5"]) == 0
    with Image.open(folder / "animation.gif") as gif:
        frames = [(gif.seek(i), gif.convert("RGB"), gif.info["duration"])[1:] for i in range(gif.n_frames)]  # pyrefly: ignore[missing-attribute]
        assert gif.size[0] == 600
    assert (len(frames), sum(duration for _, duration in frames)) == (10, 2000)
    first, last = (np.asarray(frames[i][0]).astype(int) for i in (0, -1))
    changed = np.abs(first - last).max(axis=2) > 100  # more than the colour quantisation of a GIF
    assert not changed[-40:].any()  # the legend is static
    assert changed.sum() > 1000


FEW = np.zeros((5, 3))
DAMAGE: dict[str, Callable[[Path], object]] = {
    "not a folder of results, it has no metrics.json": lambda folder: (folder / "metrics.json").unlink(),
    "metrics.json: written by another version": lambda folder: (folder / "metrics.json").write_text("{}"),
    "causal.npz: 5 poses, but": lambda folder: save(folder / "estimates/causal.npz", Estimate("filtered", FEW)),
    "causal.npz: cannot be read (No such file": lambda folder: (folder / "estimates/causal.npz").unlink(),
    f"5 rows, but the recording needs {STEPS + 1}": lambda folder: save(folder / "truth.npz", Truth(FEW)),
}


@pytest.mark.parametrize(
    ("names", "seconds", "fps", "message"),
    [
        *(([], 1.0, 5, damage) for damage in DAMAGE),
        (["fej"], 1.0, 5, "estimator 'fej': has no estimate in the folder; choose from ekf, causal, batch"),
        ([], np.nan, 5, "seconds nan: not a duration; give a number > 0, for example 10"),
        ([], 1.0, 51, "fps 51: out of range; give 1 to 50 frames per second"),
        ([], 70.0, 10, "seconds 70.0, fps 10: these are 700 frames; give 1 to 600"),
    ],
)
def test_refusals(folder: Path, names: list[str], seconds: float, fps: int, message: str):
    DAMAGE.get(message, Path.exists)(folder)
    with pytest.raises(UserError) as caught:
        animate(folder, names, seconds, fps)
    assert message in str(caught.value) and "\n" not in str(caught.value)
    assert not (folder / "animation.gif").exists()
