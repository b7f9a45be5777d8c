"""Animate a run: GIF, and MP4 with ffmpeg."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from subprocess import CalledProcessError
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter

from slamgauge.compare.estimators.requests import labels_among
from slamgauge.compare.figures.animation_scene import DOTS, Scene
from slamgauge.compare.figures.plot_style import DEAD_RECKONING, PRINT
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.progress import tracked
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.compare.storage.stored_results import load_results
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate

LOG = logging.getLogger("matplotlib.animation")
GIF, VIDEO = "animation.gif", "animation.mp4"
FILES = (GIF, VIDEO)
NO_FFMPEG = "ffmpeg is not on the PATH"
MOST_MAPS = 3  # more maps would hide each other
MOST_FRAMES = 600  # Pillow keeps all frames of a GIF in memory
FASTEST = 50  # frames per second; viewers of GIFs are not faster

# a tight bounding box, possible in a user's settings, would change the size from frame to frame
SCREEN: dict[Any, Any] = {**PRINT, "savefig.bbox": None}


def animate(folder: Path, names: Sequence[str], seconds: float, fps: int) -> str | None:
    """Write animation.gif and animation.mp4 into a folder of results.

    Args:
        folder: Folder that `slamgauge run` or `evaluate --out` wrote.
        names: Labels or addresses of the estimates to show, with their maps. By default all filtered estimates are
            shown with their maps (only the first if there are more than three), and the paths of smoothed ones.
        seconds: Duration [s].
        fps: Frames per second, at most one frame per step.

    Returns:
        The reason why animation.mp4 was not written, or None.

    Raises:
        UserError: If the folder has no results or no such estimate, the duration is out of range, or slamgauge did not
            write an existing animation.
    """
    results = load_results(folder)
    shown, mapped = _chosen(results.estimates, names)
    frames = min(_frames(seconds, fps), results.recording.steps + 1)
    steps = np.linspace(0, results.recording.steps, frames).round().astype(int).tolist()
    rate: Any = frames / seconds  # typed as int by the writers, but floats work
    staged = staged_folder(folder, FILES, last=GIF)
    with staged as stage, mpl.rc_context(SCREEN):
        scene = Scene(results, shown, mapped)
        with explained(folder, "written"):
            _render(scene, PillowWriter(rate), stage / GIF, steps)
            return _render_video(scene, rate, stage / VIDEO, steps)


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
    writer = FFMpegWriter(rate)
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
