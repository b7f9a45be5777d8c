"""A run as a moving picture (GIF; MP4 and WebM where ffmpeg is installed), or as a strip of moments for print."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from subprocess import CalledProcessError
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slamgauge.compare.estimators.requests import labels_among
from slamgauge.compare.figures.animation_scene import DOTS, SHAPES, Scene, limits
from slamgauge.compare.figures.figure_size import save_printed, sheet
from slamgauge.compare.figures.plot_style import DEAD_RECKONING, LEGEND, PRINT
from slamgauge.compare.figures.world_axes import label_plane
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.progress import tracked
from slamgauge.compare.storage.result_files import METRICS
from slamgauge.compare.storage.results_folder import Results, load_results
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate

LOG = logging.getLogger("matplotlib.animation")
GIF, STRIP = "animation.gif", ("animation.png", "animation.svg")
VIDEOS: dict[str, dict[str, Any]] = {  # and how ffmpeg writes them, where that is not its own choice
    "animation.mp4": {},
    "animation.webm": {"codec": "libvpx-vp9", "extra_args": ["-pix_fmt", "yuv420p"]},  # players know no other colours
}
MOMENTS, COLUMNS = 6, {"page": 3, "column": 2}  # of a strip
FOOT = {"page": 0.9, "column": 1.3}  # [in] for title and legend
NO_FFMPEG = "there is no ffmpeg on the PATH"
Form = Literal["usual", "gif", "mp4", "webm", "strip"]
MOST_MAPS = 3  # more than these would hide each other
MOST_FRAMES = 600  # all are in memory before a GIF is written
FASTEST = 50  # frames per second that viewers of GIFs keep up with

# a tight box, which somebody's settings may ask for, would change size from frame to frame
SCREEN: dict[Any, Any] = {**PRINT, "savefig.bbox": None}


def animate(folder: Path, names: Sequence[str], seconds: float, fps: int, form: Form = "usual") -> str | None:
    """Write animation.gif and animation.mp4, or the form asked for, into a folder of results, whole or not at all.

    Args:
        folder: what `slamgauge run` or `evaluate --out` has written.
        names: labels or addresses of the estimates to show, with their maps; without any the filtered ones with their
            maps (the first alone if there are more than three), and the smoothed ones' paths.
        seconds: how long it lasts.
        fps: frames per second; fewer where the run has fewer steps.
        form: `usual`, or one of `gif`, `mp4`, `webm` and `strip`: moments side by side, as a picture.

    Returns:
        Why there is no animation.mp4, None if there is one, or another form was asked for.

    Raises:
        UserError: there are no results, no such estimate, the length makes no sense, an animation that is not ours
            would be replaced, or a video is asked for and ffmpeg does not write it.
    """
    if form in ("mp4", "webm") and not FFMpegWriter.isAvailable():
        raise UserError(f"format {form}: {NO_FFMPEG}; install it (Debian's package ffmpeg), or give --format gif")
    results = load_results(folder)
    shown, mapped = _chosen(results.estimates, names)
    frames = min(MOMENTS if form == "strip" else _frames(seconds, fps), results.recording.steps + 1)
    steps = np.linspace(0, results.recording.steps, frames).round().astype(int).tolist()
    rate: Any = frames / seconds  # by the writers' types a whole number, which it need not be
    files = files_of(form)
    staged = staged_folder(folder, files, last=files[0], remedy="move it away", beside=METRICS)
    with staged as stage, mpl.rc_context(SCREEN):
        if form == "strip":
            with explained(folder, "written"):
                save_printed(_strip(results, shown, mapped, steps), stage / "animation")
            return None
        scene = Scene(results, shown, mapped)
        with explained(folder, "written"):
            if GIF in files:
                _render(scene, PillowWriter(rate), stage / GIF, steps)
            missing = [_render_video(scene, rate, stage / name, steps) for name in files if name in VIDEOS]
            if form in ("mp4", "webm") and missing[0] is not None:
                raise UserError(f"format {form}: {missing[0]}; give --format gif")
    return next(iter(missing), None)


def files_of(form: Form) -> tuple[str, ...]:
    """What is written, the file first that is always there."""
    if form == "strip":
        return STRIP
    return (GIF, "animation.mp4") if form == "usual" else (f"animation.{form}",)


def _strip(results: Results, shown: Mapping[str, Estimate], mapped: Mapping[str, Estimate], steps: list[int]) -> Figure:
    """The moments side by side, each as the animation has it, and one legend."""
    page, columns = sheet(), COLUMNS[sheet().width]
    low, high = limits(results, shown, mapped)
    rows = -(-len(steps) // columns)
    height = page.inches / columns * float(np.clip((high - low)[1] / (high - low)[0], *SHAPES))
    strip = Figure(figsize=(page.inches, rows * height + FOOT[page.width]), layout="constrained")
    panels = strip.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    keys: list[Line2D] = []
    for place, panel in enumerate(panels.flat):
        if place >= len(steps):
            panel.set_axis_off()
            continue
        scene = Scene(results, shown, mapped, panel)
        for step in steps[max(place - 1, 0) : place + 1]:  # sights are of the time since the moment before
            scene.show(step)
        label_plane(panel, x=place + columns >= len(steps), y=place % columns == 0)
        keys = scene.keys
    strip.suptitle(results.title)
    strip.legend(handles=keys, loc="outside lower center", ncols=page.legend_columns(len(keys)), **LEGEND)
    return strip


def _chosen(estimates: Mapping[str, Estimate], names: Sequence[str]) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    """Whose paths are shown, and whose maps among them."""
    if names:
        chosen = {name: estimates[name] for name in labels_among(names, estimates, "has no estimate in the folder")}
        return chosen, chosen
    others = {name: each for name, each in estimates.items() if name != DEAD_RECKONING} or dict(estimates)
    smoothed = {name: each for name, each in others.items() if each.kind == "smoothed"}
    filtered = [name for name in others if name not in smoothed]
    mapped = {name: others[name] for name in (filtered if len(filtered) <= MOST_MAPS else filtered[:1])}
    return mapped | smoothed, mapped or smoothed


def _frames(seconds: float, fps: int) -> int:
    if not 0 < seconds < math.inf:
        raise UserError(f"seconds {seconds}: no length of an animation; give a number > 0, for example 10")
    if not 1 <= fps <= FASTEST:
        raise UserError(f"fps {fps}: not what viewers show; give 1 to {FASTEST} frames per second")
    frames = round(seconds * fps)
    if not 1 <= frames <= MOST_FRAMES:
        raise UserError(f"seconds {seconds}, fps {fps}: give 1 to {MOST_FRAMES} frames, these are {frames}")
    return frames


def _render(scene: Scene, writer: AbstractMovieWriter, path: Path, steps: list[int]) -> None:
    """Draw every step; what is half done is not finished when that is interrupted."""
    writer.setup(scene.figure, str(path), DOTS)
    for step in tracked(steps, len(steps), "frame", path.name):
        scene.show(step)
        writer.grab_frame()
    writer.finish()


def _render_video(scene: Scene, rate: Any, path: Path, steps: list[int]) -> str | None:
    """Why there is no video, if there is none."""
    if not FFMpegWriter.isAvailable():
        return NO_FFMPEG
    writer = FFMpegWriter(rate, **VIDEOS[path.name])
    try:
        _render(scene, writer, path, steps)
    except (CalledProcessError, BrokenPipeError):  # ffmpeg lacks the codec, or the disk is full
        path.unlink(missing_ok=True)
        return "ffmpeg failed"
    except BaseException:
        LOG.disabled = True  # where ffmpeg complains of half a frame
        with suppress(CalledProcessError):  # the interrupt has reached it as well
            writer.finish()
        LOG.disabled = False
        raise
    return None
