"""Options of `slamgauge animate`."""

from __future__ import annotations

from dataclasses import dataclass

import tyro

from slamgauge.compare.cli.options.shared import Folder, Options


@dataclass
class Animate(Options):
    """Draw a run as a moving picture: animation.gif.

    It shows the paths, robots and maps of the filtered estimates (of more than three, only the first) and the paths of
    the smoothed ones. For a study it repeats the worst run, in the folder worst-run, and draws that.

    For example:
      slamgauge animate first-run --estimators ekf,riekf --seconds 20 --fps 25
    """

    folder: tyro.conf.Positional[Folder]
    """Folder that `slamgauge run`, `evaluate --out` or `study` wrote. The animation is written there too."""

    estimators: str = ""
    """Comma-separated: estimators to show, as the command of the run named them. No code of yours is run."""

    seconds: float = 10.0
    """Duration."""

    fps: int = 10
    """Frames per second. More frames make a larger GIF."""
