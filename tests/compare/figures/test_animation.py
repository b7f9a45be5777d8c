"""`slamgauge animate`: shown estimators, written files, and errors."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slamgauge.compare.cli.main import main
from slamgauge.compare.figures.animation_scene import Scene
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

needs_ffmpeg = pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg on the PATH")


@pytest.fixture
def no_ffmpeg(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")


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

    def look(_: Results, *given: dict[str, Estimate]) -> None:
        given_names.extend(list(each) for each in given)
        raise UserError("stop here")

    monkeypatch.setattr("slamgauge.compare.figures.animation.Scene", look)
    assert animate(tmp_path / "out", *arguments) == 2
    assert given_names == [shown, mapped]


# --- the files ---------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_ffmpeg")
def test_the_gif_has_the_frames_the_length_and_the_size(folder: Path):
    assert animate(folder, "--seconds", "2", "--fps", "5") == 0
    with Image.open(folder / "animation.gif") as gif:
        frames = [(gif.seek(i), gif.convert("RGB"), gif.info["duration"])[1:] for i in range(gif.n_frames)]  # pyrefly: ignore[missing-attribute]
        assert gif.size[0] == 600
        assert gif.size[1] % 2 == 0
    assert len(frames) == 10
    assert sum(duration for _, duration in frames) == 2000
    first, last = (np.asarray(frames[i][0]).astype(int) for i in (0, -1))
    changed = np.abs(first - last).max(axis=2) > 100  # more than the colour quantisation of a GIF
    assert not changed[-40:].any()  # the legend is static
    assert changed.sum() > 1000


@pytest.mark.usefixtures("no_ffmpeg")
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


@pytest.mark.parametrize("reason", ["ffmpeg is not on the PATH", "ffmpeg failed"])
def test_without_a_video_the_gif_is_the_only_new_file(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], reason: str
):
    """An animation.mp4 of an earlier command is removed."""
    if reason == "ffmpeg failed":
        (tmp_path / "ffmpeg").write_text("#!/bin/sh\nexit 1\n")
        (tmp_path / "ffmpeg").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    before = contents(folder)
    (folder / "animation.mp4").write_bytes(b"old")
    assert animate(folder, *SHORT) == 0
    assert contents(folder).keys() - before.keys() == {"animation.gif"}
    lines = [f"written to {folder}: animation.gif", f"animation.mp4 was not written: {reason}", ""]
    assert capsys.readouterr() == ("", "\n".join(lines))


@needs_ffmpeg
def test_the_video_is_an_mp4(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert animate(folder, *SHORT) == 0
    assert capsys.readouterr().err == f"written to {folder}: animation.gif, animation.mp4\n"
    assert (folder / "animation.mp4").read_bytes().startswith(b"\0\0\0 ftyp")


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures", "no_ffmpeg")
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


@pytest.mark.parametrize("frame", [3, pytest.param(9, marks=needs_ffmpeg)])
def test_an_interrupted_animation_leaves_nothing(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
    frame: int,
):
    """Interrupted while the GIF is drawn, and while the video is drawn."""
    (folder / "animation.gif").write_bytes(b"old")
    before = contents(folder)
    shown: list[int] = []
    show: Callable[[Scene, int], None] = Scene.show

    def interrupted(scene: Scene, step: int) -> None:
        shown.append(step)
        if len(shown) == frame:
            raise KeyboardInterrupt
        show(scene, step)

    monkeypatch.setattr(Scene, "show", interrupted)
    assert animate(folder, *SHORT) == 130
    assert not caplog.records
    assert capsys.readouterr().err == "slamgauge: interrupted; nothing was written\n"
    assert contents(folder) == before
    assert len(shown) == frame


# --- errors ------------------------------------------------------------------------------------


def error_message(capsys: pytest.CaptureFixture[str], folder: Path, *arguments: str) -> str:
    before = contents(folder)
    assert animate(folder, *arguments) == 2
    assert contents(folder) == before
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    return printed.err.removeprefix("slamgauge: ").rstrip("\n")


def test_folders_without_results_are_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    for place in (tmp_path, tmp_path / "nowhere"):
        expected = f"{place}: not a folder of results, it has no metrics.json; give one that `slamgauge run` or .*"
        assert re.fullmatch(expected, error_message(capsys, place))


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"estimators": {}}', "\x00"])
def test_invalid_metrics_are_an_error(folder: Path, capsys: pytest.CaptureFixture[str], text: str):
    (folder / "metrics.json").write_text(text)
    assert error_message(capsys, folder) == f"{folder}/metrics.json: not what `slamgauge run` writes; run it again"


def test_results_of_different_runs_and_without_estimates_are_an_error(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    save(folder / "estimates/causal.npz", Estimate("filtered", np.zeros((5, 3))))
    assert error_message(capsys, folder).startswith(
        f"{folder}/estimates/causal.npz: 5 poses, but the recording in this folder needs"
    )
    (folder / "estimates/causal.npz").unlink()
    assert "causal.npz: cannot be read (No such file" in error_message(capsys, folder)
    save(folder / "truth.npz", Truth(np.zeros((5, 3))))
    assert error_message(capsys, folder).startswith(f"truth.poses: 5 rows, but the recording needs {STEPS + 1}")
    write(tmp_path / "out", {})
    assert "no estimators" in error_message(capsys, tmp_path / "out")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--estimators", "fej"], "estimator 'fej': has no estimate in the folder; choose from ekf, causal, batch"),
        (["--seconds", "0"], "seconds 0.0: not a duration; give a number > 0, for example 10"),
        (["--seconds", "nan"], "seconds nan: not a duration; give a number > 0, for example 10"),
        (["--fps", "0"], "fps 0: out of range; give 1 to 50 frames per second"),
        (["--fps", "51"], "fps 51: out of range; give 1 to 50 frames per second"),
        (["--seconds", "70"], "seconds 70.0, fps 10: these are 700 frames; give 1 to 600"),
        (["--seconds", "0.001"], "seconds 0.001, fps 10: these are 0 frames; give 1 to 600"),
    ],
)
def test_settings_out_of_range(folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str):
    assert error_message(capsys, folder, *arguments) == message
