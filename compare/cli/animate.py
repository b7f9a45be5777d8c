"""`slamgauge animate`."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import tyro

from slamgauge.compare.cli.options import (
    Folder,
    split_names,
)


@dataclass
class Animate:
    """Show a run as a moving picture: animation.gif, and animation.mp4 where ffmpeg is installed.

    For example:
      slamgauge animate first-run --estimators ekf,riekf --seconds 20 --fps 25
    """

    folder: tyro.conf.Positional[Folder]
    """What `slamgauge run` or `slamgauge evaluate --out` has written; the animation goes there too."""

    estimators: str = ""
    """Comma-separated, as that command was given them: whose paths, robots and maps to show; if not given those of all
    filtered estimates (of more than three, of the first), and the paths of the smoothed ones. Nobody's code is run."""

    seconds: float = 10.0
    """How long it lasts."""

    fps: int = 10
    """Frames per second; a GIF grows with them."""

    def __call__(self) -> None:
        """Draw and write."""
        from slamgauge.compare.figures.animation import animate

        missing = animate(self.folder, split_names(self.estimators), self.seconds, self.fps)
        print(f"written to {self.folder / 'animation.gif'}{'' if missing else ' and .mp4'}", file=sys.stderr)
        if missing:
            print(f"animation.mp4 is left out: {missing}", file=sys.stderr)
