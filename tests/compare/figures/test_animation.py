"""`slamgauge animate`: shown estimators, the GIF, and refusals of damaged folders."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from PIL import Image

from slamgauge.compare.cli.main import main
from slamgauge.compare.figures.frames import animate, chosen
from slamgauge.compare.figures.maps import Scene
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


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


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


def test_an_interrupted_animation_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch):
    (folder / "animation.gif").write_bytes(b"old")
    before, draw = contents(folder), Scene.draw

    def interrupted(scene: Scene, ax: Axes, step: int, after: int) -> None:
        if step > 100:
            raise KeyboardInterrupt
        draw(scene, ax, step, after)

    monkeypatch.setattr(Scene, "draw", interrupted)
    with pytest.raises(KeyboardInterrupt):
        animate(folder, [], 1.0, 6)
    assert contents(folder) == before


FEW = np.zeros((5, 3))
EMPTY = '{"scenario": "q4", "seed": 7, "estimators": {}}'
DAMAGE: dict[str, Callable[[Path], object]] = {
    "": Path.exists,
    "no metrics": lambda folder: (folder / "metrics.json").unlink(),
    "empty metrics": lambda folder: (folder / "metrics.json").write_text("{}"),
    "no estimators": lambda folder: (folder / "metrics.json").write_text(EMPTY),
    "short estimate": lambda folder: save(folder / "estimates/causal.npz", Estimate("filtered", FEW)),
    "no estimate": lambda folder: (folder / "estimates/causal.npz").unlink(),
    "short truth": lambda folder: save(folder / "truth.npz", Truth(FEW)),
}


@pytest.mark.parametrize(
    ("damage", "names", "seconds", "fps", "message"),
    [
        ("no metrics", [], 1.0, 5, "not a folder of results, it has no metrics.json; give one that `slamgauge run` or"),
        ("empty metrics", [], 1.0, 5, "metrics.json: written by another version, or changed by hand; run its command"),
        ("no estimators", [], 1.0, 5, "metrics.json: contains no estimators; run the command again with at least one"),
        ("short estimate", [], 1.0, 5, "causal.npz: 5 poses, but the recording in this folder needs"),
        ("no estimate", [], 1.0, 5, "causal.npz: cannot be read (No such file"),
        ("short truth", [], 1.0, 5, f"truth.poses: 5 rows, but the recording needs {STEPS + 1}"),
        ("", ["fej"], 1.0, 5, "estimator 'fej': has no estimate in the folder; choose from ekf, causal, batch"),
        ("", [], 0.0, 5, "seconds 0.0: not a duration; give a number > 0, for example 10"),
        ("", [], np.nan, 5, "seconds nan: not a duration; give a number > 0, for example 10"),
        ("", [], 1.0, 51, "fps 51: out of range; give 1 to 50 frames per second"),
        ("", [], 70.0, 10, "seconds 70.0, fps 10: these are 700 frames; give 1 to 600"),
        ("", [], 0.001, 10, "seconds 0.001, fps 10: these are 0 frames; give 1 to 600"),
    ],
)
def test_refusals(folder: Path, damage: str, names: list[str], seconds: float, fps: int, message: str):
    DAMAGE[damage](folder)
    before = contents(folder)
    with pytest.raises(UserError) as caught:
        animate(folder, names, seconds, fps)
    assert message in str(caught.value) and "\n" not in str(caught.value)
    assert contents(folder) == before
