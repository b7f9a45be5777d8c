"""`slamgauge animate`: shown estimators, written files, and errors."""

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
from slamgauge.compare.figures.maps import Scene
from slamgauge.compare.storage.files import Results, save
from slamgauge.compare.storage.staged_folder import begin_folder
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.truth import Truth
from tests.reference.example_rays import STEPS, estimate_with_rays, half_loop

pytestmark = pytest.mark.slow

WITH_RAYS = estimate_with_rays()
NO_HISTORY = replace(WITH_RAYS, rays=None, history=None)
SMOOTHED = replace(NO_HISTORY, kind="smoothed")
SHORT = ("--seconds", "1", "--fps", "6")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Results of `ekf` with rays, `causal` without a history, and `batch`."""
    out = tmp_path / "results"
    write(out, {"ekf": WITH_RAYS, "causal": NO_HISTORY, "batch": SMOOTHED})
    return out


def write(folder: Path, estimates: dict[str, Estimate]) -> None:
    truth, recording = half_loop()
    begin_folder(folder)
    (folder / "estimates").mkdir()
    save(folder / "recording.npz", recording)
    save(folder / "truth.npz", truth)
    for name, estimate in estimates.items():
        save(folder / "estimates" / f"{name}.npz", estimate)
    metrics = {"scenario": "q4", "seed": 7, "estimators": dict.fromkeys(estimates)}
    (folder / "metrics.json").write_text(json.dumps(metrics), encoding="utf-8")


def animate(folder: Path, *arguments: str) -> int:
    return main(["animate", str(folder), *arguments])


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# --- shown estimators --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "arguments", "shown", "mapped"),
    [
        ("dead-reckoning,ekf,causal,batch", "", "ekf,causal,batch", "ekf,causal"),
        ("ekf,riekf,iekf,causal,batch", "", "ekf,batch", "ekf"),
        ("ekf,causal,batch", "causal", "causal", "causal"),
        ("ekf,batch", "batch", "batch", "batch"),
        ("a,b,c,d,batch", "d,batch,b,c", "d,batch,b,c", "d,batch,b,c"),
        ("ekf,me", "me=some/where.py:slam,ekf", "me,ekf", "me,ekf"),
        ("batch", "", "batch", "batch"),
        ("dead-reckoning", "", "dead-reckoning", "dead-reckoning"),
    ],
)
def test_estimators_shown_with_paths_and_maps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: str, arguments: str, shown: str, mapped: str
):
    write(tmp_path / "out", {name: SMOOTHED if name == "batch" else NO_HISTORY for name in names.split(",")})
    (tmp_path / "some").mkdir()
    (tmp_path / "some/where.py").write_text("def slam(recording): pass")
    monkeypatch.chdir(tmp_path)
    given_names: list[str] = []

    def look(_: Results, *given: dict[str, Estimate]) -> None:
        given_names.extend(",".join(each) for each in given)
        raise UserError("stop here")

    monkeypatch.setattr("slamgauge.compare.figures.frames.Scene", look)
    assert animate(tmp_path / "out", *(["--estimators", arguments] if arguments else [])) == 2
    assert given_names == [shown, mapped]


# --- the files ---------------------------------------------------------------------------------


def test_the_gif_has_the_frames_the_length_and_the_size(folder: Path):
    assert animate(folder, "--seconds", "2", "--fps", "5") == 0
    with Image.open(folder / "animation.gif") as gif:
        frames = [(gif.seek(i), gif.convert("RGB"), gif.info["duration"])[1:] for i in range(gif.n_frames)]  # pyrefly: ignore[missing-attribute]
        assert gif.size[0] == 600
    assert len(frames) == 10
    assert sum(duration for _, duration in frames) == 2000
    first, last = (np.asarray(frames[i][0]).astype(int) for i in (0, -1))
    changed = np.abs(first - last).max(axis=2) > 100  # more than the colour quantisation of a GIF
    assert not changed[-40:].any()  # the legend is static
    assert changed.sum() > 1000


def test_a_short_run_has_fewer_frames(tmp_path: Path):
    write(tmp_path / "out", {})
    truth, recording = half_loop()
    assert truth.poses is not None
    few = recording.first(3)
    save(tmp_path / "out/recording.npz", few)
    save(tmp_path / "out/truth.npz", replace(truth, poses=truth.poses[:4], association=few.landmark))
    save(tmp_path / "out/estimates/own.npz", Estimate("filtered", truth.poses[:4] + 0.1))
    (tmp_path / "out/metrics.json").write_text('{"scenario": null, "seed": null, "estimators": {"own": {}}}')
    assert animate(tmp_path / "out", "--seconds", "2") == 0
    with Image.open(tmp_path / "out/animation.gif") as gif:
        assert gif.n_frames == 4  # pyrefly: ignore[missing-attribute]


def test_an_interrupted_animation_leaves_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    (folder / "animation.gif").write_bytes(b"old")
    before = contents(folder)
    draw = Scene.draw

    def interrupted(scene: Scene, ax: Axes, step: int, after: int) -> None:
        if step > 100:
            raise KeyboardInterrupt
        draw(scene, ax, step, after)

    monkeypatch.setattr(Scene, "draw", interrupted)
    assert animate(folder, *SHORT) == 130
    assert capsys.readouterr().err.startswith("slamgauge: interrupted; ")
    assert contents(folder) == before


# --- errors ------------------------------------------------------------------------------------


FEW = np.zeros((5, 3))
DAMAGE: dict[str, Callable[[Path], object]] = {
    "": Path.exists,
    "no metrics": lambda folder: (folder / "metrics.json").unlink(),
    "empty metrics": lambda folder: (folder / "metrics.json").write_text("{}"),
    "no estimators": lambda folder: (folder / "metrics.json").write_text(
        '{"scenario": "q4", "seed": 7, "estimators": {}}'
    ),
    "short estimate": lambda folder: save(folder / "estimates/causal.npz", Estimate("filtered", FEW)),
    "no estimate": lambda folder: (folder / "estimates/causal.npz").unlink(),
    "short truth": lambda folder: save(folder / "truth.npz", Truth(FEW)),
}


@pytest.mark.parametrize(
    ("damage", "arguments", "message"),
    [
        ("no metrics", "", "not a folder of results, it has no metrics.json; give one that `slamgauge run` or"),
        ("empty metrics", "", "metrics.json: written by another version, or changed by hand; run its command again"),
        ("no estimators", "", "metrics.json: contains no estimators; run the command again with at least one"),
        ("short estimate", "", "causal.npz: 5 poses, but the recording in this folder needs"),
        ("no estimate", "", "causal.npz: cannot be read (No such file"),
        ("short truth", "", f"truth.poses: 5 rows, but the recording needs {STEPS + 1}"),
        ("", "--estimators fej", "estimator 'fej': has no estimate in the folder; choose from ekf, causal, batch"),
        ("", "--seconds 0", "seconds 0.0: not a duration; give a number > 0, for example 10"),
        ("", "--seconds nan", "seconds nan: not a duration; give a number > 0, for example 10"),
        ("", "--fps 51", "fps 51: out of range; give 1 to 50 frames per second"),
        ("", "--seconds 70", "seconds 70.0, fps 10: these are 700 frames; give 1 to 600"),
        ("", "--seconds 0.001", "seconds 0.001, fps 10: these are 0 frames; give 1 to 600"),
    ],
)
def test_refusals(folder: Path, capsys: pytest.CaptureFixture[str], damage: str, arguments: str, message: str):
    DAMAGE[damage](folder)
    before = contents(folder)
    assert animate(folder, *arguments.split()) == 2
    assert contents(folder) == before
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert message in printed.err
