"""Make `build/links/slamgauge` like the installed package, for tools that follow no import hooks."""

from __future__ import annotations

import shutil
from pathlib import Path

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Link the modules and folders of `core/`, and the three other packages."""
    links = ROOT / "build/links/slamgauge"
    shutil.rmtree(links, ignore_errors=True)
    links.mkdir(parents=True)
    folders = (each.parent for each in (ROOT / "core").glob("*/__init__.py"))
    for place in (*(ROOT / "core").glob("*.py"), *folders, ROOT / "ekf", ROOT / "graph_baseline", ROOT / "compare"):
        (links / place.name).symlink_to(place)


if __name__ == "__main__":
    main()
