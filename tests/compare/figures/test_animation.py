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
from slamgauge.compare.figures.scene import Scene
from slamgauge.compare.storage.files import save
from slamgauge.compare.storage.staged_folder import begin_folder
from slamgauge.compare.storage.stored_results import Results, load_results
from slamgauge.compare.studies.stored_study import load_study
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
        (["dead-reckoning", "ekf", "causal", "batch"], [], ["ekf", "causal", "batch"], ["ekf", "causal"]),
        (["ekf", "riekf", "iekf", "causal", "batch"], [], ["ekf", "batch"], ["ekf"]),
        (["ekf", "causal", "batch"], ["--estimators", "causal"], ["causal"], ["causal"]),
        (["ekf", "batch"], ["--estimators", "batch"], ["batch"], ["batch"]),
        (
            ["a", "b", "c", "d", "batch"],
            ["--estimators", "d,batch,b,c"],
            ["d", "batch", "b", "c"],
            ["d", "batch", "b", "c"],
        ),
        (["ekf", "me"], ["--estimators", "me=some/where.py:slam,ekf"], ["me", "ekf"], ["me", "ekf"]),
        (["ekf", "mine.py:slam"], ["--estimators", "far/mine.py:slam"], ["mine.py:slam"], ["mine.py:slam"]),
        (["batch"], [], ["batch"], ["batch"]),
        (["dead-reckoning"], [], ["dead-reckoning"], ["dead-reckoning"]),
    ],
)
def test_estimators_shown_with_paths_and_maps(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    names: list[str],
    arguments: list[str],
    shown: list[str],
    mapped: list[str],
):
    write(tmp_path / "out", {name: SMOOTHED if name == "batch" else NO_HISTORY for name in names})
    for file in ("some/where.py", "far/mine.py"):
        (tmp_path / file).parent.mkdir()
        (tmp_path / file).write_text("def slam(recording): pass")
    monkeypatch.chdir(tmp_path)
    given_names: list[list[str]] = []

    def look(_: Axes, __: Results, *given: dict[str, Estimate]) -> None:
        given_names.extend(list(each) for each in given)
        raise UserError("stop here")

    monkeypatch.setattr("slamgauge.compare.figures.animation.Scene", look)
    assert animate(tmp_path / "out", *arguments) == 2
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
    assert truth.association is not None
    few = recording.first(3)
    save(tmp_path / "out/recording.npz", few)
    save(tmp_path / "out/truth.npz", replace(truth, poses=truth.poses[:4], association=few.landmark))
    save(tmp_path / "out/estimates/own.npz", Estimate("filtered", truth.poses[:4] + 0.1))
    (tmp_path / "out/metrics.json").write_text('{"scenario": null, "seed": null, "estimators": {"own": {}}}')
    assert load_results(tmp_path / "out").title == "out"
    assert animate(tmp_path / "out", "--seconds", "2") == 0
    with Image.open(tmp_path / "out/animation.gif") as gif:
        assert gif.n_frames == 4  # pyrefly: ignore[missing-attribute]


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures")
def test_the_worst_run_of_a_study_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    words = ("study", "q1-short-dense", "--set", "trajectory.duration=3", "--runs", "3", "--estimators", "ekf,causal")
    assert main([*words, "--jobs", "1", "--no-report", "--out", str(tmp_path)]) == 0
    runs = load_study(tmp_path).runs["causal"]
    worst = int(np.argmax(runs.figures["ate_m"]))
    capsys.readouterr()
    assert animate(tmp_path, "--estimators", "causal", *SHORT) == 0
    assert f"run {worst}, the worst of causal:" in capsys.readouterr().err
    found = json.loads((tmp_path / "worst-run/metrics.json").read_text())
    assert found["estimators"]["causal"]["ate_m"] == pytest.approx(runs.figures["ate_m"][worst], rel=1e-9)
    assert (tmp_path / "worst-run/animation.gif").exists()


def test_an_interrupted_animation_leaves_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    (folder / "animation.gif").write_bytes(b"old")
    before = contents(folder)
    show = Scene.show

    def interrupted(scene: Scene, step: int) -> None:
        if step > 100:
            raise KeyboardInterrupt
        show(scene, step)

    monkeypatch.setattr(Scene, "show", interrupted)
    assert animate(folder, *SHORT) == 130
    assert capsys.readouterr().err == "slamgauge: interrupted; nothing was written\n"
    assert contents(folder) == before


# --- errors ------------------------------------------------------------------------------------


def lose_estimate(folder: Path) -> None:
    (folder / "estimates/causal.npz").unlink()


def shorten_estimate(folder: Path) -> None:
    save(folder / "estimates/causal.npz", Estimate("filtered", np.zeros((5, 3))))


def shorten_truth(folder: Path) -> None:
    save(folder / "truth.npz", Truth(np.zeros((5, 3))))


def empty_metrics(folder: Path) -> None:
    (folder / "metrics.json").write_text("{}")


def no_estimators(folder: Path) -> None:
    (folder / "metrics.json").write_text('{"scenario": "q4", "seed": 7, "estimators": {}}')


def lose_metrics(folder: Path) -> None:
    (folder / "metrics.json").unlink()


def nothing(_: Path) -> None:
    pass


@pytest.mark.parametrize(
    ("damage", "arguments", "message"),
    [
        (lose_metrics, "", "not a folder of results, it has no metrics.json; give one that `slamgauge run` or"),
        (empty_metrics, "", "metrics.json: not what `slamgauge run` writes; run it again"),
        (no_estimators, "", "metrics.json: contains no estimators; run the command again with at least one"),
        (shorten_estimate, "", "causal.npz: 5 poses, but the recording in this folder needs"),
        (lose_estimate, "", "causal.npz: cannot be read (No such file"),
        (shorten_truth, "", f"truth.poses: 5 rows, but the recording needs {STEPS + 1}"),
        (nothing, "--estimators fej", "estimator 'fej': has no estimate in the folder; choose from ekf, causal, batch"),
        (nothing, "--seconds 0", "seconds 0.0: not a duration; give a number > 0, for example 10"),
        (nothing, "--seconds nan", "seconds nan: not a duration; give a number > 0, for example 10"),
        (nothing, "--fps 51", "fps 51: out of range; give 1 to 50 frames per second"),
        (nothing, "--seconds 70", "seconds 70.0, fps 10: these are 700 frames; give 1 to 600"),
        (nothing, "--seconds 0.001", "seconds 0.001, fps 10: these are 0 frames; give 1 to 600"),
    ],
)
def test_refusals(
    folder: Path, capsys: pytest.CaptureFixture[str], damage: Callable[[Path], None], arguments: str, message: str
):
    damage(folder)
    before = contents(folder)
    assert animate(folder, *arguments.split()) == 2
    assert contents(folder) == before
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert message in printed.err
