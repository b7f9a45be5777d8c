"""Figures kept instead of written, and files written twice."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from slamgauge.compare.figures import plot_style

Written = Callable[[Callable[[Path], object], str], tuple[bytes, bytes]]


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, Figure]:
    """Saved figures by name; no files are written."""
    found: dict[str, Figure] = {}

    def keep(figure: Figure, path: Path) -> None:
        found[path.name] = figure

    monkeypatch.setattr(plot_style, "save_printed", keep)
    return found


@pytest.fixture
def written_twice(tmp_path: Path) -> Written:
    """A function that draws a figure into two folders and returns its png and svg, which must be equal in both."""

    def written(draw: Callable[[Path], object], name: str) -> tuple[bytes, bytes]:
        contents: list[tuple[bytes, bytes]] = []
        for folder in (tmp_path / "first", tmp_path / "second"):
            folder.mkdir()
            draw(folder)
            contents.append(((folder / f"{name}.png").read_bytes(), (folder / f"{name}.svg").read_bytes()))
        assert contents[0] == contents[1]
        return contents[0]

    return written
