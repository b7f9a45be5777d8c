"""Animate a run (GIF; MP4 and WebM with ffmpeg), or draw a strip of moments for print."""

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
from slamgauge.compare.figures.axes import label_plane
from slamgauge.compare.figures.plot_style import DEAD_RECKONING, LEGEND, PRINT, save_printed, sheet
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.progress import tracked
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.compare.storage.stored_results import Results, load_results
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate

LOG = logging.getLogger("matplotlib.animation")
GIF, STRIP = "animation.gif", ("animation.png", "animation.svg")
VIDEOS: dict[str, dict[str, Any]] = {  # files and options of ffmpeg
    "animation.mp4": {},
    "animation.webm": {"codec": "libvpx-vp9", "extra_args": ["-pix_fmt", "yuv420p"]},  # the format that players support
}
MOMENTS, COLUMNS = 6, {"page": 3, "column": 2}  # panels of a strip, and panels per row
FOOT = {"page": 0.9, "column": 1.3}  # [in] for title and legend
NO_FFMPEG = "ffmpeg is not on the PATH"
Form = Literal["usual", "gif", "mp4", "webm", "strip"]
MOST_MAPS = 3  # more maps would hide each other
MOST_FRAMES = 600  # Pillow keeps all frames of a GIF in memory
FASTEST = 50  # frames per second; viewers of GIFs are not faster

# a tight bounding box, possible in a user's settings, would change the size from frame to frame
SCREEN: dict[Any, Any] = {**PRINT, "savefig.bbox": None}


def animate(folder: Path, names: Sequence[str], seconds: float, fps: int, form: Form = "usual") -> str | None:
    """Write animation.gif and animation.mp4, or the requested form, into a folder of results.

    Args:
        folder: Folder that `slamgauge run` or `evaluate --out` wrote.
        names: Labels or addresses of the estimates to show, with their maps. By default all filtered estimates are
            shown with their maps (only the first if there are more than three), and the paths of smoothed ones.
        seconds: Duration [s].
        fps: Frames per second, at most one frame per step.
        form: `usual`, `gif`, `mp4`, `webm`, or `strip` (a picture of six moments).

    Returns:
        The reason why animation.mp4 was not written, or None.

    Raises:
        UserError: If the folder has no results or no such estimate, the duration is out of range, slamgauge did not
            write an existing animation, or ffmpeg does not write the requested video.
    """
    if form in ("mp4", "webm") and not FFMpegWriter.isAvailable():
        raise UserError(f"format {form}: {NO_FFMPEG}; install it (Debian's package ffmpeg), or give --format gif")
    results = load_results(folder)
    shown, mapped = _chosen(results.estimates, names)
    frames = min(MOMENTS if form == "strip" else _frames(seconds, fps), results.recording.steps + 1)
    steps = np.linspace(0, results.recording.steps, frames).round().astype(int).tolist()
    rate: Any = frames / seconds  # typed as int by the writers, but floats work
    files = files_of(form)
    staged = staged_folder(folder, files, last=files[0])
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
    """Return the files of a form; the first one is always written."""
    if form == "strip":
        return STRIP
    return (GIF, "animation.mp4") if form == "usual" else (f"animation.{form}",)


def _strip(results: Results, shown: Mapping[str, Estimate], mapped: Mapping[str, Estimate], steps: list[int]) -> Figure:
    """Draw the frames of the given steps side by side, with one legend."""
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
        for step in steps[max(place - 1, 0) : place + 1]:  # shows the observations since the previous moment
            scene.show(step)
        label_plane(panel, x=place + columns >= len(steps), y=place % columns == 0)
        keys = scene.keys
    strip.suptitle(results.title)
    strip.legend(handles=keys, loc="outside lower center", ncols=page.legend_columns(len(keys)), **LEGEND)
    return strip


def _chosen(estimates: Mapping[str, Estimate], names: Sequence[str]) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    """Return the estimates whose paths are shown, and those whose maps are shown."""
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
        raise UserError(f"seconds {seconds}: not a duration; give a number > 0, for example 10")
    if not 1 <= fps <= FASTEST:
        raise UserError(f"fps {fps}: out of range; give 1 to {FASTEST} frames per second")
    frames = round(seconds * fps)
    if not 1 <= frames <= MOST_FRAMES:
        raise UserError(f"seconds {seconds}, fps {fps}: these are {frames} frames; give 1 to {MOST_FRAMES}")
    return frames


def _render(scene: Scene, writer: AbstractMovieWriter, path: Path, steps: list[int]) -> None:
    """Draw every step and finish the file; an interrupt leaves it unfinished."""
    writer.setup(scene.figure, str(path), DOTS)
    for step in tracked(steps, len(steps), "frame", path.name):
        scene.show(step)
        writer.grab_frame()
    writer.finish()


def _render_video(scene: Scene, rate: Any, path: Path, steps: list[int]) -> str | None:
    """Write a video; return the reason if that fails, else None."""
    if not FFMpegWriter.isAvailable():
        return NO_FFMPEG
    writer = FFMpegWriter(rate, **VIDEOS[path.name])
    try:
        _render(scene, writer, path, steps)
    except (CalledProcessError, BrokenPipeError):  # ffmpeg lacks the codec, or the disk is full
        path.unlink(missing_ok=True)
        return "ffmpeg failed"
    except BaseException:
        LOG.disabled = True  # ffmpeg reports the incomplete frame there
        with suppress(CalledProcessError):  # ffmpeg was interrupted as well
            writer.finish()
        LOG.disabled = False
        raise
    return None
