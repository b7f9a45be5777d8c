"""Figures that are written twice."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

Written = Callable[[Callable[[Path], object], str], tuple[bytes, bytes]]


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
